"""The plan of the house holds: less weight, no circle, short files, docstrings with
shapes.
"""

import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from tests.support.docstrings import shapeless, silent
from tests.support.rooms import (
    ROOT,
    edges,
    floor_room,
    house_room,
    imports,
    ladder,
    modules,
    text,
)
from tests.support.weight import weight

RUNBOOKS = ROOT / "runbooks"
NOTES = ROOT / "tests" / "lab" / "notes"
PRODUCT_WEIGHT, PRODUCT_MODULES, TEST_WEIGHT = 115_894, 391, 89_088
PAGE_WORDS = 20_000
ROOMS, ARROWS = 16, 70
LONGEST_MODULE = 600  # lines


def test_weight_of_the_house_only_falls() -> None:
    """The bounds are a ratchet: they only fall, and nobody raises one.

    Whoever takes weight out commits the lower number with it; whoever adds takes out as
    much elsewhere. What weighs is said in `tests.support.weight`.
    """
    product = [path for _, path in modules()]
    assert _weight_of(product) <= PRODUCT_WEIGHT
    assert len(product) <= PRODUCT_MODULES
    assert _weight_of((ROOT / "tests").rglob("*.py")) <= TEST_WEIGHT


def _weight_of(paths: Iterable[Path]) -> int:
    return sum(map(weight, map(text, paths)))


def test_no_name_of_a_class_stands_for_two_things() -> None:
    names: list[str] = []
    for _, path in modules():
        names += re.findall(r"(?m)^class ([A-Z]\w+)", text(path))
    assert sorted(names) == sorted({*names})


def test_pages_have_no_more_words_than_a_reader_has_patience_for() -> None:
    pages = (ROOT / "README.md", ROOT / "CHANGELOG.md", *RUNBOOKS.rglob("*.md"))
    assert sum(len(text(page).split()) for page in pages) <= PAGE_WORDS


def test_imports_between_rooms_go_one_way() -> None:
    found = edges(floor_room)
    assert len(ladder(found)) == len(found)


def test_the_house_has_few_rooms_and_few_arrows() -> None:
    found = edges(house_room)
    assert len(found) <= ROOMS
    assert sum(map(len, found.values())) <= ARROWS


def test_no_modules_import_each_other_in_a_circle_not_even_inside_functions() -> None:
    known = {name for name, _ in modules()}
    packages = {name.rsplit(".", 1)[0] for name in known if "." in name}
    found = {
        name: (imports(path) & known) - {name} - packages for name, path in modules()
    }
    alone = {name: others for name, others in found.items() if name not in packages}
    assert len(ladder(alone)) == len(alone)


def test_no_module_is_too_long() -> None:
    assert not [
        name
        for name, path in modules()
        if len(text(path).splitlines()) > LONGEST_MODULE
    ]


def test_every_public_function_with_arrays_names_their_shape() -> None:
    assert not shapeless()


def test_every_public_function_that_raises_says_so() -> None:
    assert not silent()


def test_runbooks_and_readme_name_only_commands_files_and_headings_that_exist() -> None:
    missing = Counter()
    for page in (ROOT / "README.md", *RUNBOOKS.rglob("*.md"), *NOTES.glob("*.md")):
        words = text(page)
        for module in re.findall(r"python -m (tests[\w.]*\w)", words):
            path = ROOT / module.replace(".", "/")
            missing[module] += not (
                path.with_suffix(".py").is_file() or (path / "__main__.py").is_file()
            )
        for file in re.findall(
            r"`((?:cell|drivers|policies|calibration|tests)/[\w/]+\.py)`", words
        ):
            missing[file] += not (ROOT / file).is_file()
        for link, heading in re.findall(r"\]\(([\w/.-]*)(?:#([\w-]+))?\)", words):
            target = page.parent / link if link else page
            missing[f"{page.name}: {link}"] += not target.exists()
            if heading and target.is_file():
                missing[f"{page.name}: {link}#{heading}"] += heading not in headings(
                    target
                )
    assert not +missing


def headings(page: Path) -> set[str]:
    """Anchors of the headings of a page, as they stand in links to them."""
    titles = re.findall(r"(?m)^#+ (.*)$", text(page))
    return {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}
