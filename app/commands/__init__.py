"""Options and help texts of the commands, declared once; heavy modules are loaded where they are used. Never
the work itself.
"""
