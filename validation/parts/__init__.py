"""Single components: benchmarks, orders of convergence, reduction, and independent implementations
of them. Never machines.
"""
