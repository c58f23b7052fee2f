"""Any second-order system of a reduced machine, dense or with few entries: static, modal, damped,
frequency and time response. Never finite elements.
"""
