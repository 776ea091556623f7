"""The application: what an operator types, the orchestrator, its monitors and its record."""
