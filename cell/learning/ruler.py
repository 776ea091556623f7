"""A laid fold measured with a ruler: what the camera does not see of the rig's error."""

from pathlib import Path

from cell.learning.experience import Experience, Memory
from cell.record.run import read_run
from drivers.errors import ConfigurationError


def ruler_experience(folder: Path, edges: float, memory: Memory) -> Experience:
    """The experience of the run in `folder`, whose laid edges lie `edges` [m] apart by a ruler.

    `memory` knows to which policy, fabric and specimen the run belongs. Raises ConfigurationError
    for a run that cannot be read, whose edges no camera saw, or that the cell did not learn from.
    """
    run = read_run(folder)
    seen = None if run.result is None else run.result.edge_offset
    if seen is None:
        raise ConfigurationError(
            f"{folder}: result.yaml: edge_offset: is missing, the camera saw no laid edges; "
            "measure a fold that was laid down"
        )
    for known in reversed(memory.experiences()):
        if known.run == folder.resolve().name and known.kind == "camera":
            return Experience(
                run=known.run,
                policy=known.policy,
                strip=known.strip,
                specimen=known.specimen,
                kind="ruler",
                rig=edges - seen,
            )
    raise ConfigurationError(
        f"{folder}: this cell did not learn from the run; fold with `--learning on` first"
    )
