"""The studies of a scene, ``[studies.NAME]``: their points, records, tables and costs. Never
poses.
"""
