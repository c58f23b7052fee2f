"""The machine drawn to PNG by VTK or by the painter, in a child process. Never charts."""
