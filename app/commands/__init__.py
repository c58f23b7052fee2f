"""Signatures and help texts of the commands; nothing heavy is imported at the top. Never work."""
