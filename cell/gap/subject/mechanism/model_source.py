"""Reads MuJoCo models, MJCF or URDF, without foreign code or files outside their
folder.
"""

import math
import os
import re
import resource
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Lock
from typing import Any
from xml.parsers import expat

import mujoco

from drivers.base.errors import ConfigurationError
from drivers.base.readers import MEGABYTE, file_digest, read_text

ASSETS = ("mesh", "hfield", "skin", "texture")  # with files that are read when compiled
REPEATERS = ("replicate", "composite", "flexcomp")
MOST_BODIES = 2000  # loading takes the square of copies: 115 s for 20,000
MOST_BYTES = 200 * MEGABYTE  # of a model's text, and of all files that it names
MOST_MEMORY = 2000 * MEGABYTE  # that MuJoCo may take for a model and its state
SIZE_KEY = re.compile(r"n\w+|width|height|dim|size|memory|count")
WHOLE = re.compile(r"(\d+)([KMGT]?)")

_MEMORY_LOCK = Lock()  # of the limit, which is the whole process's


@dataclass(frozen=True, slots=True)
class ModelSource:
    """Text of a MuJoCo model, from which it is compiled; those joints named in `motors`
    that nothing drives get a motor each.

    Its paths count from `folder`, and stay `within` that of the mechanism's file.
    `digests` are the SHA-256 of the model, included files and meshes, by path, each as
    it was before it was read.
    """

    text: str
    folder: Path
    within: Path
    motors: tuple[str, ...] = ()
    digests: Mapping[Path, str] = field(default_factory=dict)

    def spec(self) -> Any:
        """Specification of the model, as MuJoCo parses it from the text, with the added
        motors.
        """
        spec = mujoco.MjSpec.from_string(self.text)
        spec.modelfiledir = f"{self.folder}/"
        for body in spec.bodies[1:]:
            body.simple = False  # an edit may move its mass off its axes

        drives = spec.actuators
        on_joint = mujoco.mjtTrn.mjTRN_JOINT
        taken = {d.name for d in drives} | {
            d.target for d in drives if d.trntype == on_joint
        }
        bare = {joint.name for joint in spec.joints} - taken
        for joint in dict.fromkeys(name for name in self.motors if name in bare):
            spec.add_actuator(name=joint, target=joint, trntype=on_joint)

        return spec


def read_source(path: Path, folder: Path) -> ModelSource:
    """Read the text of the MJCF or URDF model at `path` with all files that it
    includes, and refuse whatever would run foreign code.

    Raises ConfigurationError for text that is no XML, plugins, files that are read
    while parsing, and files outside `folder`.
    """
    digests = {path.resolve(): file_digest(path)}
    text = read_text(path, MOST_BYTES)
    root = _root(text, path)
    if root.tag not in ("mujoco", "robot"):
        raise ConfigurationError(f"{path}: root is <{root.tag}>; give MJCF or URDF")

    if _include(root, path, folder, digests) or root.tag == "robot":
        _plain_urdf(root, folder, path.parent)
        text = ET.tostring(root, encoding="unicode")

    for element in root.iter():
        tag = element.tag
        if tag in ("plugin", "extension"):
            raise ConfigurationError(
                f"{path}: <{tag}>: plugins run foreign code and are refused; remove it"
            )
        if tag in ("flex", "flexcomp"):
            raise ConfigurationError(
                f"{path}: <{tag}>: {element.get('name', '')!r} is deformable; rigid"
                " bodies are compared: leave it out"
            )
        if element.get("file") is not None and tag not in ASSETS:
            raise ConfigurationError(
                f"{path}: <{tag} file>: is not read; write it into the model"
            )

    _check_copies(root, path)
    return ModelSource(text, path.parent, folder, digests=digests)


def _root(text: str, path: Path) -> ET.Element:
    """Root element of the XML `text`; ConfigurationError where it is invalid or
    declares entities.
    """
    if "<!ENTITY" in text or "<!DOCTYPE" in text:
        raise ConfigurationError(f"{path}: declares XML entities; write them out")

    # prefixes may be undeclared in URDFs
    builder = ET.TreeBuilder()
    parser = expat.ParserCreate()
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data

    try:
        parser.Parse(text, True)
        return builder.close()
    except expat.ExpatError as error:
        raise ConfigurationError(
            f"{path}: is not valid XML: {error}; give MJCF or URDF"
        ) from None


def _include(
    root: ET.Element, path: Path, folder: Path, digests: dict[Path, str]
) -> bool:
    """Replace each `include` element below `root` by the content of the file that it
    names, and return whether there was any.

    `digests` of the files so far are added to. Paths count from the folder of the
    model, and a file is included once, as MuJoCo has it.
    """
    found = False
    for parent in list(root.iter()):
        for element in parent.findall("include"):
            place = _inside(path, path.parent / element.get("file", ""), folder)
            if place in digests:
                raise ConfigurationError(
                    f"{path}: includes {place.name} twice; allowed: once"
                )
            digests[place] = file_digest(place)
            inner = _root(read_text(place, MOST_BYTES), place)
            _include(inner, path, folder, digests)
            at = list(parent).index(element)
            parent.remove(element)
            for k, child in enumerate(inner):
                parent.insert(at + k, child)
            found = True
    return found


def _plain_urdf(root: ET.Element, folder: Path, place: Path) -> None:
    """Remove elements that are meant for other programs from a URDF model, and replace
    names of packages in its paths by files.
    """
    for parent in list(root.iter()):
        parent[:] = [e for e in parent if e.tag != "gazebo" and ":" not in e.tag]
        for key in [key for key in parent.attrib if ":" in key]:
            del parent.attrib[key]
    for mesh in root.iter("mesh"):
        scheme, _, of_package = mesh.get("filename", "").partition("package://")
        name, separator, file = of_package.partition("/")
        if separator and not scheme:
            own = name == folder.name or not (folder / name).is_dir()
            whole = folder / ("" if own else name) / file
            mesh.set("filename", os.path.relpath(whole, place))


def _check_copies(root: ET.Element, path: Path, copies: int = 1) -> None:
    """Raise ConfigurationError where elements such as `replicate` would multiply bodies
    beyond a limit.
    """
    for element in root:
        stated = element.get("count", "") if element.tag in REPEATERS else ""
        counts = map(int, re.findall(r"[0-9]+", stated))
        inside = copies * math.prod(max(1, count) for count in counts)
        if inside > MOST_BODIES:
            raise ConfigurationError(
                f"{path}: <{element.tag}>: makes {inside} copies; allowed:"
                f" {MOST_BODIES}"
            )
        _check_copies(element, path, inside)


def _inside(origin: Path, place: Path, folder: Path) -> Path:
    """Resolved path of the file `place`; ConfigurationError where it lies outside
    `folder` or is no regular file.
    """
    whole = place.resolve()
    name = os.path.relpath(place, folder)
    if not whole.is_relative_to(folder.resolve()):
        raise ConfigurationError(
            f"{origin}: {name}: lies outside {folder}; paths of a model stay in its"
            " folder"
        )
    if not whole.is_file():
        raise ConfigurationError(
            f"{origin}: {name}: there is no such file in {folder}; add it"
        )
    return whole


def with_assets(source: ModelSource, origin: str) -> ModelSource:
    """Copy of `source` that also holds the digests of all meshes and textures that the
    model names.

    Raises ConfigurationError as `compile_model`.
    """
    with _loading(source, origin):
        with _limited_memory():
            spec = source.spec()
        _check_spec(spec, source, origin)
    found = {path: file_digest(path) for path in _assets(spec, source, origin)}
    return replace(source, digests={**source.digests, **found})


def _check_spec(spec: Any, source: ModelSource, origin: str) -> None:
    """Raise ConfigurationError where a parsed model names files outside its folder or
    is too large.
    """
    count = len(spec.bodies)
    if count > MOST_BODIES:
        raise ConfigurationError(
            f"{origin}: has {count} bodies; allowed: {MOST_BODIES}"
        )
    if spec.nkey > MOST_BODIES:
        raise ConfigurationError(
            f"{origin}: size nkey is {spec.nkey}; allowed: {MOST_BODIES}"
        )

    total = 0
    for path in _assets(spec, source, origin):
        total += path.stat().st_size
        if total > MOST_BYTES:
            raise ConfigurationError(
                f"{origin}: {path.name}: meshes and textures hold over"
                f" {MOST_BYTES // MEGABYTE} MB; thin them, or leave those of looks out"
            )


def _assets(spec: Any, source: ModelSource, origin: str) -> Iterator[Path]:
    """Yield the paths of the meshes and textures of a parsed model; ConfigurationError
    for one outside its folder.
    """
    shapes = [x.file for x in (*spec.meshes, *spec.hfields, *spec.skins)]
    textures = [name for x in spec.textures for name in (x.file, *x.cubefiles)]
    for place, files in ((spec.meshdir, shapes), (spec.texturedir, textures)):
        for file in filter(None, files):
            name = Path(file).name if spec.strippath else file
            path = source.folder / place / name
            yield _inside(Path(origin), path, source.within)


@contextmanager
def _limited_memory() -> Iterator[None]:
    """Context within which this process gets only a limited amount of memory beyond
    what it has.
    """
    pages, *_ = Path("/proc/self/statm").read_text(encoding="ascii").split()
    space = resource.RLIMIT_AS
    with _MEMORY_LOCK:
        before = resource.getrlimit(space)
        limit = int(pages) * resource.getpagesize() + MOST_MEMORY
        known = [bound for bound in before if bound != resource.RLIM_INFINITY]
        resource.setrlimit(space, (min([limit, *known]), before[1]))
        try:
            yield
        finally:
            resource.setrlimit(space, before)


@contextmanager
def _loading(source: ModelSource, origin: str) -> Iterator[None]:
    """Context that turns the errors which MuJoCo raises while it loads a model into a
    ConfigurationError about `origin`.
    """
    try:
        yield
    except (ValueError, RuntimeError, MemoryError, mujoco.FatalError) as error:
        reason = " ".join(str(error).split())
        # what MuJoCo does not catch is a failed allocation
        if isinstance(error, RuntimeError | MemoryError) or "allocate" in reason:
            raise _too_large(source, origin) from None
        raise ConfigurationError(
            f"{origin}: does not load: {reason[:160]}; mend it"
        ) from None


def _too_large(source: ModelSource, origin: str) -> ConfigurationError:
    """Error for a model that takes too much memory, which names the element with the
    largest numbers in it.
    """
    elements = ET.fromstring(source.text).iter()  # noqa: S314 read above
    largest = max(elements, key=lambda element: math.prod(_sizes(element).values()))
    stated = " ".join(f'{key}="{largest.get(key)}"' for key in _sizes(largest))
    named = f' name="{name}"' if (name := largest.get("name")) else ""
    return ConfigurationError(
        f"{origin}: does not load within {MOST_MEMORY / 1e9:g} GB of memory; largest"
        f" in it is <{largest.tag}{named} {stated}>; make it smaller"
    )


def _sizes(element: ET.Element) -> dict[str, int]:
    """Whole numbers in an element of MJCF that say how much memory it takes, by
    attribute; K, M and G behind them are factors.
    """
    sizes = {}
    for key, text in element.attrib.items():
        number = WHOLE.fullmatch(text)
        if number and SIZE_KEY.fullmatch(key):
            sizes[key] = int(number[1]) << 10 * " KMGT".index(number[2] or " ")
    return sizes


def compile_model(
    source: ModelSource,
    origin: str,
    slots: int,
    step: float,
    edit: Callable[[Any], None] = lambda _: None,
) -> Any:
    """Compile the model of `source` by MuJoCo, with `slots` user numbers for each joint
    and with the time step `step` [s].

    `edit` changes its specification. RK4 replaces the Euler integrator. Raises
    ConfigurationError for a model that does not load, and for one that takes more than
    MOST_MEMORY.
    """
    with _loading(source, origin):
        with _limited_memory():
            spec = source.spec()

        edit(spec)
        _check_spec(spec, source, origin)
        option = spec.option
        compiler = spec.compiler
        spec.nuser_jnt = slots
        option.timestep = step
        if option.integrator == mujoco.mjtIntegrator.mjINT_EULER:
            option.integrator = mujoco.mjtIntegrator.mjINT_RK4

        of_geoms = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
        # each simulation copies the model
        compiler.discardvisual = compiler.inertiafromgeom != of_geoms
        with _limited_memory():
            model = spec.compile()
    # or edited frames are ignored
    model.body_sameframe[:] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE
    return model
