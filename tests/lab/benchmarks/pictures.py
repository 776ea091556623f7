"""Takes pictures of recordings in Rerun and of pages in a browser: `pictures OUT PATH...`.

A PATH is a run's folder, of which beginning, middle and end are shown, a recording, or
a page. Each is looked at on a desk and, if a page, on a phone, by day and by night.
"""

import base64
from pathlib import Path

from cell.record.run import read_run
from tests.support.browser import LOOKS, Browser, Look, browser
from tests.support.viewer import PLACES, cut, picture, recording_until

SHARES = {"middle": 0.3, "end": 1.0}  # of a run's time
LONGEST = 12_000  # px of a page's height


def main(out: Path, paths: list[Path]) -> None:
    """Write PNG files of `paths` into the folder `out`, and print what they show."""
    out.mkdir(parents=True, exist_ok=True)
    recordings = [path for path in paths if path.suffix == ".rrd" or path.is_dir()]
    for path in recordings:
        for name, recording in _recordings(path, out):
            image = picture(recording, out / f"{name}.png")
            contrasts = (f"{at} {cut(image, at).std():.0f}" for at in PLACES)
            print(f"{name}: contrast of {', '.join(contrasts)}")
    pages = [path / "report.html" if path.is_dir() else path for path in paths]
    with browser() as reader:
        for page in pages:
            if page.suffix == ".html":
                _photograph(reader, page, out)


def _recordings(path: Path, out: Path) -> list[tuple[str, Path]]:
    """Names and recordings of the run or recording at `path`."""
    if path.suffix == ".rrd":
        return [(f"{path.parent.name}-{path.stem}", path)]
    end = float(read_run(path).ticks.t[-1])
    found = [(f"{path.name}-begin", path / "run.rrd")]
    for word, share in SHARES.items():
        name = f"{path.name}-{word}"
        part = recording_until(path, share * end, out / f"{name}.rrd")
        found.append((name, part))
    return found


def _photograph(reader: Browser, page: Path, out: Path) -> None:
    """Write a picture of the whole `page` for each of LOOKS, and print its faults."""
    for look in LOOKS:
        name = f"{page.parent.name}-{page.stem}-{look.width}-{look.scheme}"
        print(f"{name}: {reader.problems(page, look) or 'no faults'}")
        height = int(reader.evaluate("document.documentElement.scrollHeight"))
        content = _capture(reader, look, min(height, LONGEST))
        (out / f"{name}.png").write_bytes(content)


def _capture(reader: Browser, look: Look, height: int) -> bytes:
    clip = {"x": 0, "y": 0, "width": look.width, "height": height, "scale": 1}
    found = reader.ask(
        "Page.captureScreenshot", clip=clip, captureBeyondViewport=True, format="png"
    )
    return base64.b64decode(found["data"])
