"""The command `cell replay`: repeats perception and decisions of a run on its stored images."""

import sys

from cell.cli.options import Json, Run, busy, print_json


def replay(run: Run, as_json: Json = False) -> None:
    """Repeat a run's perception and decisions from its record; exit code 1 if a result differs."""
    with busy("repeating perception and decisions from the record"):
        from cell.folding.replay import replay as decide_again

        result = decide_again(run)
    if as_json:
        facts = {"run": run, "images": result.images, "decisions": result.decisions}
        print_json({**facts, "differences": result.differences})
    else:
        text = "the same" if result.same else f"{len(result.differences)} differences"
        sys.stdout.write(f"{result.images} images, {result.decisions} decisions: {text}\n")
        sys.stdout.writelines(f"  {line}\n" for line in result.differences)
    sys.exit(0 if result.same else 1)
