"""Any second-order system with dense matrices: static, modal, damped, frequency, time; modes paired and followed. Never finite elements."""
