"""SciPy, whose parts are loaded when something of them is first used: together they take a fifth of
a second, and reading and checking a scene need none of them.
"""

from typing import TYPE_CHECKING

from headstock.geometry.loading import Library

if TYPE_CHECKING:
    import scipy as scipy
else:
    scipy = Library("scipy")
