"""What each command does, from its parsed options to an exit code. Never the declaration of an option
or the drawing of anything.
"""
