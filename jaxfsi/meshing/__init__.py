"""From an anatomy to a labelled, conforming mesh of blood and wall."""
