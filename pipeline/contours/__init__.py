"""A contour milled by any machine: the stage, what is cut, and each kind of machine on its way.

Never here: other analyses, and numerics that know nothing of scenes.
"""
