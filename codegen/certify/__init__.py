"""Certificates in exact rational arithmetic, on the very constants that the C holds.

Nothing here trusts a solver, and nothing here is shared with ``synthesis``.
"""
