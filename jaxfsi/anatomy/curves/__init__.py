"""Curves in space, and sections along them."""
