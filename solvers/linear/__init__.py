"""Any second-order system of a reduced machine, dense or with few entries: static, modal, damped,
and frequency response. Never finite elements.
"""
