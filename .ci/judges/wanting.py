"""How a judge ends: by a line on what it finds wanting."""


def require(held: object, words: str) -> None:
    """End this program with `words`, unless what they say is `held` to be true."""
    if not held:
        raise SystemExit(f"wanting: {words}")
