"""The machine and its parts drawn to PNG by pyvista, in a child process. Never charts."""
