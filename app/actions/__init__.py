"""What each command does, from its options to an exit code. Never the declaration of an option or the
drawing of anything.
"""
