"""Adapters of native meshers, each a file that a child process loads on its own."""
