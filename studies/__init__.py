"""Many runs or poses of one scene. Never printing, charts or reference values."""
