"""Any second-order system with dense matrices: static, modal, damped, frequency and time response;
modes paired and tracked. Never finite elements.
"""
