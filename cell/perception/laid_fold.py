"""Check that a fold lies as it was laid: the camera sees its edges where they were released."""

from dataclasses import dataclass

EDGE_TOLERANCE = 0.015  # m between the grasped edge as seen and where the gripper opened


@dataclass(frozen=True, slots=True)
class LaidFold:
    """Offsets [m] of the grasped edge from the fixed one in a laid fold, with the sign of d.

    `released` is that where the gripper opened, `seen` the one that the camera sees after the
    retreat, None where the image shows no loop that can be measured.
    """

    released: float
    seen: float | None

    def complaint(self) -> tuple[str, str] | None:
        """Outcome name and reason where the fold failed; None where it lies as it was laid."""
        if self.seen is None:
            return (
                "edges_not_seen",
                "the layers touched, but the camera sees no fold where it was laid: the strip "
                "sprang open or is hidden; look at it, and lay it again",
            )
        if abs(self.seen - self.released) > EDGE_TOLERANCE:
            return (
                "edges_apart",
                f"the laid edges are {1e3 * self.seen:+.1f} mm apart, the gripper let go of them "
                f"at {1e3 * self.released:+.1f} mm (allowed {1e3 * EDGE_TOLERANCE:.0f} "
                "mm from there): the strip slipped, stretched or sprang open; look at the grip and "
                "the strip",
            )
        return None
