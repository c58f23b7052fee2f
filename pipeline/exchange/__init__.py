"""Matrices of bodies in the files of other programs: one module a format, from and to one record."""
