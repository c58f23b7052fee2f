"""Parameters from measurements: targets, model and derivatives, descent, statistics, the file of
the fit.

Never a parameter that is varied without a measurement.
"""
