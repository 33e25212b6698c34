"""Documents, figures and pages of results."""
