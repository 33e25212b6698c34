"""Newton's method, the tangent, and the preconditioned Krylov solver."""
