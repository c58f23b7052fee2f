"""Parameters from measurements: targets, model and slopes, descent, statistics, what it leaves. Never other searches."""
