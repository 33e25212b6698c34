"""Computations: a case or record in, numbers out. Nothing here draws or writes a page."""
