"""Inputs that clumsy or hostile users give, and what must become of them."""
