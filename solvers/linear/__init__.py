"""Any second-order system of a reduced machine, dense or with few entries: static, modal, damped,
frequency and time response; modes paired and tracked. Never finite elements.
"""
