"""Poles and shapes fitted to measured frequency responses. Never files of testers, never a model to
compare them with.
"""
