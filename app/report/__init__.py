"""The HTML pages with their SVG, templates and viewer. Never the terminal."""
