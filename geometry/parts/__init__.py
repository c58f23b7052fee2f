"""One body: its solid, faces and patches, interfaces, mass properties and visible skin. Never
joints, axes or poses.
"""
