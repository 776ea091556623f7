"""Causes outside the library at two strengths, measured on the chain; `None` yet."""

OUTSIDE: dict[str, dict[str, dict[str, float]]] = {}
