"""What each command does, from its parsed options to an exit code. Never the spelling of an option
or the drawing of anything.
"""
