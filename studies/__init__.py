"""Many runs or poses of one scene: studies, sweeps, comparisons, effects, identification. Never
printing, charts or reference values.
"""
