"""Single components: benchmarks, orders, reduction, and second implementations of them. Never machines."""
