"""typer without rich. Its help is plain text here, and Markdown, highlighters and tables that it
would load for help in colours take longer than all the rest of a command line.
"""

import sys

_rich = sys.modules.get("rich")
sys.modules["rich"] = None  # type: ignore[assignment]  # what cannot be imported is not installed
try:
    import typer as typer
finally:
    del sys.modules["rich"]
    if _rich is not None:
        sys.modules["rich"] = _rich
# where somebody else had loaded it before: it would escape brackets for rich all the same
typer.core.rich = None  # type: ignore[assignment, attr-defined]
