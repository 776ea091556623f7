"""The plan of the house holds: few rooms, few doors, no circle, short files, plain docstrings."""

import ast
import re
from collections import Counter
from pathlib import Path

from tests.support.capitals import ambiguous_capitals, kind_of
from tests.support.docstrings import shapeless, silent
from tests.support.rooms import (
    ROOT,
    edges,
    floor_room,
    imports,
    inner_room,
    ladder,
    modules,
    sizes,
    tree,
)
from tests.support.words import is_participle, participles, told_lines

LONGEST_MODULE, LONGEST_FUNCTION = 400, 60  # lines
ROOMS, LARGEST_ROOM, DOORS = 40, 5000, 240


def test_rooms_are_few_and_none_hides_behind_its_parent() -> None:
    found = sizes()
    assert len(found) <= ROOMS
    assert not {room: lines for room, lines in found.items() if lines > LARGEST_ROOM}


def test_imports_between_rooms_are_few() -> None:
    assert sum(map(len, edges(inner_room).values())) <= DOORS


def test_imports_between_rooms_go_one_way() -> None:
    found = edges(floor_room)
    assert len(ladder(found)) == len(found)


def test_no_modules_import_each_other_in_a_circle_not_even_inside_functions() -> None:
    known = {name for name, _ in modules()}
    packages = {name.rsplit(".", 1)[0] for name in known if "." in name}
    found = {name: (imports(path) & known) - {name} - packages for name, path in modules()}
    alone = {name: others for name, others in found.items() if name not in packages}
    assert len(ladder(alone)) == len(alone)


def test_no_module_and_no_function_is_too_long() -> None:
    long = [n for n, path in modules() if len(path.read_text().splitlines()) > LONGEST_MODULE]
    for name, whole in ((name, tree(path)) for name, path in modules()):
        for node in ast.walk(whole):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines = (node.end_lineno or node.lineno) - node.lineno + 1
                long += [f"{name}:{node.name}"] if lines > LONGEST_FUNCTION else []
    assert not long


def test_every_public_function_with_arrays_names_their_shape() -> None:
    assert not shapeless()


def test_every_public_function_that_raises_says_so() -> None:
    assert not silent()


def test_no_retired_word_is_used() -> None:
    assert not told_lines()
    assert not participles()


def test_no_capital_stands_for_values_of_two_kinds_or_units() -> None:
    assert not ambiguous_capitals()


def test_kind_of_a_value_is_read_from_its_text() -> None:
    known = {"WIDTH": "number", "FOLDER": "path"}
    kinds = {
        "number": ("-1.5", "2 * WIDTH", "np.pi", "1 << 20", "float('nan')"),
        "text": ("'hand'", "f'{x}'", "'-' * 3"),
        "path": ("Path('a') / 'b'", "FOLDER / WIDTH", "Path(__file__).parents[2] / 'configs'"),
        "sequence": ("(1, 2)", "np.array([0.1])", "[0] * 7"),
        "mapping": ("{'a': 1}", "dict(a=1)"),
        "set": ("frozenset({1})", "{1} | OTHER"),
        "Struct": ("struct.Struct('<I')",),
        None: ("made(1)", "OTHER", "OTHER[1]"),
    }
    for kind, values in kinds.items():
        for value in values:
            assert kind_of(ast.parse(value, mode="eval").body, known) == kind, value


def test_participles_are_distinguished_from_verbs_and_nouns() -> None:
    assert all(map(is_participle, ("moved", "shown", "judged", "said")))
    assert not any(map(is_participle, ("speed", "run", "set", "moved_camera", "move")))


def test_runbooks_and_readme_name_only_commands_files_and_headings_that_exist() -> None:
    missing = Counter()
    for page in [ROOT / "README.md", *(ROOT / "runbooks").rglob("*.md")]:
        text = page.read_text(encoding="utf-8")
        for module in re.findall(r"python -m (tests[\w.]+)", text):
            missing[module] += not (ROOT / f"{module.replace('.', '/')}.py").is_file()
        for file in re.findall(r"`((?:cell|drivers|policies|calibration|tests)/[\w/]+\.py)`", text):
            missing[file] += not (ROOT / file).is_file()
        for link, heading in re.findall(r"\]\(([\w/.-]*)(?:#([\w-]+))?\)", text):
            target = page.parent / link if link else page
            missing[f"{page.name}: {link}"] += not target.exists()
            if heading and target.is_file():
                missing[f"{page.name}: {link}#{heading}"] += heading not in headings(target)
    assert not +missing


def headings(page: Path) -> set[str]:
    """Anchors of the headings of a page, as they stand in links to them."""
    titles = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}
