"""Ways of a tool with steps in time: contours milled by any machine, straight moves of a mechanism's
tool, what is cut, and each kind of machine along its trajectory.

Never here: other analyses, and numerics that know nothing of scenes.
"""
