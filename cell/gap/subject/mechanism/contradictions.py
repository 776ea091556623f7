"""Recordings of a mechanism held against its model before any fit: motion, torques,
contacts.

Torques are regressed on the model's, joint by joint and run by run: a factor, a sign
and a lag belong to the recording, whatever the mechanism lacks.
"""

import copy
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import Any, NamedTuple

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline

from cell.gap.subject.mechanism.model import Mechanism, poses
from cell.gap.subject.mechanism.recordings import Recording, Signal
from cell.gap.subject.run_table import stuck_reading
from cell.gap.subject.subject import Finding, bad
from drivers.base.errors import in_percent
from drivers.base.types import Array

# Set by hand on cases, and on runs of models that others wrote, which stay within.
STANDS = 1e-3  # rad or m, most of a run in which nothing moves
MOST_LAG, LAGS = 0.1, 81  # s, of either sign, and number that are tried
LEAST_LAG, ROWS = 2e-3, 0.5  # s, and rows, within which stamps are not told apart
SURE = 4.0  # standard errors from which a lag is told
FOLLOWS, FREE = 0.9, 0.2  # correlation with the model; share that a motion explains
FACTOR = 8.0  # of torques: a link may well be four times as heavy as stated
GEARED, NEAR_UNIT, NEAR_GEAR = 3.0, 1.15, 2.0  # a gear's ratio; within a known factor
UNLIKE = 2.0  # times the other runs' factor
LOUD = 4.0  # times its noise, the spread of a torque that is judged
MOST = 0.6  # share of the runs that is all of them
REVERSES = 0.2  # of a joint's typical rate, within which its friction is not known
SLIDING = 0.05  # of a joint's typical rate, within which friction changes its sign
PLACES, SHORTEST = 400, 40  # of a run that are compared; fewer say nothing
TOUCHED, TOUCHES = 0.5, 0.02  # share of poses in contact, refused and said
POSES = 60  # of a run
UNITS = {1000.0: "N mm", 100.0: "N cm", 10.2: "kgf cm", 0.102: "kgf m", 0.001: "kN m",
         8.85: "lbf in", 141.6: "ozf in"}  # fmt: skip
"""Units of torque by how many of them are a newton metre."""
STEPS, STEP = np.linspace(-MOST_LAG, MOST_LAG, LAGS, retstep=True)
TINY = np.finfo(float).tiny  # against division by zero
UNBOUNDED = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))
HOLD = (int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD))


class JointTorques(NamedTuple):
    """Torques at one joint in one run, one for each time, both `measured` and as the
    stated `model` predicts them.

    `t` (n,) [s] are their times, `q`, `v`, `a` (n,) the motion of the joint. What is
    faster than `cutoff` [rad/s] was filtered out.
    """

    t: Array
    measured: Array
    model: Array
    q: Array
    v: Array
    a: Array
    cutoff: float

    @property
    def friction(self) -> Array:
        """Three functions of the joint's motion, one in each row, that its friction and
        a constant offset may follow: one, the rate, and the smoothed sign of the rate.
        """
        v = self.v
        sliding = SLIDING * np.sqrt(np.mean(v**2)) + TINY
        return np.array([np.ones_like(v), v, np.tanh(v / sliding)])

    @property
    def of_motion(self) -> Array:
        """Six functions of the joint's motion, one in each row, that may add up to its
        torque: the three of friction, sine and cosine of the angle, and the
        acceleration.
        """
        return np.vstack([self.friction, np.sin(self.q), np.cos(self.q), self.a])


class Match(NamedTuple):
    """How the measured torques of one joint follow the model's: they are `factor` times
    as large, and late by some lag.

    `follows` is their correlation beside friction, `explained` the share of the
    variance that the motion explains. `misfits` (LAGS,) are chi^2 of each lag above the
    best one, of independent places, by what the best leaves or, if more, the noise.
    """

    factor: float
    follows: float
    explained: float
    misfits: Array


def match(torques: JointTorques, noise: float) -> Match | None:
    """Compare measured `torques`, of the stated `noise` [N m], with the model's by
    linear regression at several lags; None where the run is too short.

    Beside the model's each lag has its own torques of the motion, for what a mechanism
    lacks has the clock of what it holds.
    """
    t = torques.t
    v = torques.v
    span = np.ptp(t)
    # about a reversal friction may hold a joint, and torque leads its motion
    moves = abs(v) > REVERSES * v.std()
    inner = np.flatnonzero((abs(t - t[0] - span / 2) <= span / 2 - MOST_LAG) & moves)
    readings = len(inner)
    if readings < SHORTEST:
        return None
    inner = inner[:: max(1, readings // PLACES)]
    model = torques.model[inner]
    measured = CubicSpline(t, torques.measured)(t[inner] + STEPS[:, None])

    motion = np.vstack([torques.of_motion[:, inner], model])
    squares = np.mean(_beside(motion, measured) ** 2, axis=1)
    best = np.argmin(squares)
    # a random torque follows as many functions as it has degrees of freedom
    free = torques.cutoff * span / np.pi * readings / len(t)
    least = squares[best]
    left = least * free / max(free - len(motion), 1.0)
    # or as much of the noise as passes the filter
    own = max(left, free / readings * noise**2)

    friction = torques.friction[:, inner]
    model, matched = _beside(friction, np.array([model, measured[best]]))
    cross = model @ matched
    square = model @ model + TINY
    return Match(
        factor=cross / square,
        follows=abs(cross) / np.sqrt(square * (matched @ matched)),
        explained=1.0 - left / measured[best].var(),
        misfits=free * (squares - least) / own,
    )


def _beside(columns: Array, rows: Array) -> Array:
    """Rows of `rows` after least squares has removed from each whatever is linear in
    the rows of `columns`.
    """
    basis, _ = np.linalg.qr(columns.T)
    beside: Array = rows - (rows @ basis) @ basis.T
    return beside


def _least_lag(misfits: Array) -> tuple[float, float]:
    """Lag [s] at which a parabola through the chi-squared values `misfits`, one for
    each tried lag, is least, and the standard error [s] of that lag.
    """
    k = np.clip(np.argmin(misfits), 1, LAGS - 2)
    before, least, after = misfits[k - 1 : k + 2]
    bend = max(before - 2.0 * least + after, TINY)
    aside = 0.5 * (before - after) / bend
    return STEPS[k] + aside * STEP, STEP * np.sqrt(2.0 / bend)


def judge_torques(
    mechanism: Mechanism, runs: Mapping[str, Sequence[JointTorques]]
) -> Iterator[Finding]:
    """Findings on the measured torques of all signals, run by run: those in another
    unit, of other sign, at another time than the model's, or of no motion at all.

    What most runs show is said of all; a run that differs from the others, by name.
    """
    lags: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for signal, found in matches(mechanism, runs):
        usual = float(np.median([m.factor for m in found.values()] or [1.0]))
        faults = {run: _fault(mechanism, signal, m, usual) for run, m in found.items()}
        yield from _said(faults)
        for run, m in found.items():
            lag, error = _least_lag(m.misfits)
            if not faults[run] and abs(lag) < MOST_LAG:
                lags[run].append((lag, error))
    if lags:
        yield from _late(mechanism, lags)


def matches(
    mechanism: Mechanism, runs: Mapping[str, Sequence[JointTorques]]
) -> Iterator[tuple[Signal, dict[str, Match]]]:
    """Yield each compared torque with how it follows the model's in those runs, by
    name, in which it is louder than its noise.
    """
    for signal, *by_run in zip(
        mechanism.compared("torque"), *runs.values(), strict=True
    ):
        found = {}
        sigma = signal.sigma
        for run, torques in zip(runs, by_run, strict=True):
            loud = torques.measured.std() > LOUD * sigma
            if loud and (matched := match(torques, sigma)):
                found[run] = matched
        yield signal, found


def _late(
    mechanism: Mechanism, by_run: Mapping[str, Sequence[tuple[float, float]]]
) -> Iterator[Finding]:
    """Findings on measured torques that are late or early beside the motion, from the
    lags [s] of all signals in each run with their standard errors [s].

    All torques have one clock in all runs, or else in a run that differs from the
    others by more than they do from each other.
    """
    rows = [np.median(np.diff(r.t)) for r in mechanism.recordings]
    least = max(LEAST_LAG, ROWS * max(rows))
    lag, error, _ = _pooled([*chain(*by_run.values())])
    if abs(lag) > max(least, SURE * error):
        yield _lag(lag)
    each_run = by_run.items()
    for run, lags in each_run if len(each_run) > 2 else ():
        others = [each for other, each in each_run if other != run]
        usual, of_usual, scatter = _pooled([*chain(*others)])
        lag, error, _ = _pooled(lags, scatter)
        apart = min(abs(lag), abs(lag - usual))
        if apart > max(least, SURE * np.hypot(error, of_usual)):
            yield _lag(lag).model_copy(update={"run": run})


def _pooled(
    lags: Sequence[tuple[float, float]], scatter: float = 0.0
) -> tuple[float, float, float]:
    """Weighted mean of the given lags [s] with their standard errors, the standard
    error of that mean, and the scatter of the lags beyond their errors.

    What a mechanism lacks shifts each lag by another amount: random effects, of at
    least the stated `scatter` (DerSimonian and Laird 1986, Meta-analysis in clinical
    trials).
    """
    values, errors = np.transpose(lags)
    weights = errors**-2.0
    mean, whole = np.average(values, weights=weights, returned=True)
    excess = weights @ (values - mean) ** 2 - (len(values) - 1)
    total = whole - weights @ weights / whole
    between = max(excess / (total + TINY), scatter**2)
    weights = 1.0 / (errors**2 + between)
    mean, whole = np.average(values, weights=weights, returned=True)
    return mean, whole**-0.5, between**0.5


def _said(by_run: Mapping[str, Finding | None]) -> Iterator[Finding]:
    """Faults of one signal, given by run; a fault that most runs have is yielded once
    for all of them, others with the name of their run.
    """
    faults = [(run, fault) for run, fault in by_run.items() if fault]
    counts = Counter(fault.what for _, fault in faults)
    shared = {what for what, n in counts.items() if n > max(1.0, MOST * len(by_run))}
    alone = ", unlike other runs" if len(by_run) > 1 else ""
    told: set[str] = set()
    for run, fault in faults:
        what = fault.what
        if what not in shared:
            words = fault.words + alone
            yield fault.model_copy(update={"run": run, "words": words})
        elif what not in told:
            told.add(what)
            yield fault


def _fault(
    mechanism: Mechanism, signal: Signal, found: Match, usual: float
) -> Finding | None:
    """Finding on one `signal` in one run, or None where its torques agree with the
    model; `usual` is the factor between measured and predicted torque in most runs.
    """
    name = signal.name
    factor = found.factor
    if found.explained < FREE:
        return bad(
            "torque of no motion",
            f"{name}: the motion explains {in_percent(max(found.explained, 0.0))} of"
            " this torque",
            "look for the column that holds it, or leave the run out",
        )
    if found.follows < FOLLOWS:
        return None
    fault = _unit(mechanism, signal, factor)
    if fault is None and factor < 0.0:
        fault = bad(
            "sign",
            f"{name} is the model's torque reversed ({factor:.2f} times)",
            f"write `reversed: true` for {name} in the mapping, or turn its sign",
            mend={name: {"reversed": True}},
        )
    elif fault is None and not 1.0 / UNLIKE < factor / abs(usual) < UNLIKE:
        fault = bad(
            "contradicts the others",
            f"{name} is {factor:.2f} times the model's, {abs(usual):.2f} in most runs",
            "look for a load that run.yaml does not state, or leave it out",
        )
    return fault


def _unit(mechanism: Mechanism, signal: Signal, factor: float) -> Finding | None:
    """Finding on a `signal` whose torques are `factor` times the model's, with the unit
    or gear that may explain it, or None where the factor is near one.
    """
    size = abs(factor)
    name = signal.name
    stated = abs(mechanism.model.actuator_gear[signal.actuator, 0])
    side, gear = ("motor", stated) if signal.gear == stated else ("joint", 1.0 / stated)
    turned = ", reversed" if factor < 0.0 else ""
    words = f"{name}: is {size:.3g} times the model's torque at the {side}{turned}"
    if not _is_near(gear, 1.0, GEARED) and _is_near(size, gear, NEAR_GEAR):
        other = "joint" if side == "motor" else "motor"
        words += (
            f", close to the gear ratio {stated:g}: it was probably measured at the"
            f" {other}"
        )
        return bad(
            "gear",
            words,
            f"state side: {other}",
            mend={name: {"side": other, "reversed": turned != ""}},
        )
    if _is_near(size, 1.0, FACTOR):
        return None
    for unit, symbol in UNITS.items():
        if _is_near(size, unit, NEAR_UNIT):
            factor = float(f"{1.0 / unit:.4g}")
            remedy = f"write `factor: {factor:g}` for {name} in the mapping"
            mend = {name: {"factor": factor, "reversed": turned != ""}}
            return bad("unit", f"{words}: in {symbol}?", remedy, mend=mend)
    remedy = "state its unit or `factor` in the mapping, or the motor's gain"
    return bad("unit", words, remedy)


def _is_near(size: float, known: float, within: float) -> bool:
    """Whether `size` differs from the number `known` by less than the factor `within`,
    up or down.
    """
    return 1.0 / within < size / known < within


def _lag(lag: float) -> Finding:
    """Finding on measured torques whose times lag behind those of the motion by `lag`
    [s], or lead where that is negative.
    """
    if lag > 0.0:
        return bad(
            "lag",
            f"torques are late by {1e3 * lag:.1f} ms beside positions",
            f"take {lag:.4f} s off the stamps of torques where the two streams are"
            " merged, or record both by one clock",
        )
    return Finding(
        what="lag",
        words=f"positions are late by {-1e3 * lag:.1f} ms beside torques",
        remedy="the fit tries it as sensor_delay; record both by one clock",
    )


def contradictions(mechanism: Mechanism) -> Iterator[Finding]:
    """Findings on recordings with angles that were unwrapped or readings that never
    change, and on parts of the model that touch along the measured motion.
    """
    for recording in mechanism.recordings:
        for words in recording.notes:
            yield Finding(what="wrapped", run=recording.name, words=words, remedy="")
        yield from _standing(mechanism, recording)
    yield from _touching(mechanism)


def _standing(mechanism: Mechanism, recording: Recording) -> Iterator[Finding]:
    """Findings on a recording in which no joint moves, or in which some column never
    changes while others do.
    """
    columns = recording.columns
    positions = mechanism.places
    run = recording.name
    places = [recording.known(name)[1] for name in positions.values()]
    largest = max(map(np.ptp, places), default=np.inf)
    if largest < STANDS:
        yield Finding(
            what="no motion",
            run=run,
            words=f"no joint moves by more than {1e3 * largest:.2g} mrad or mm",
            remedy="leave it out, unless it was held still on purpose",
        )
        return
    for name in dict.fromkeys([*positions.values(), *mechanism.file.signals]):
        for found in stuck_reading(name, recording.t, columns[name]):
            yield found.model_copy(update={"run": run})


def _touching(mechanism: Mechanism) -> Iterator[Finding]:
    """Findings on geoms that touch along the measured motion, in a model whose contacts
    are switched off.
    """
    model = mechanism.model
    places = mechanism.places
    if model.npair or mechanism.mode.group or len(places) < model.njnt:
        return
    columns = [places[j.name] for j in mechanism.joints]
    by_run = [r.poses(columns) for r in mechanism.recordings]
    q = np.vstack([known[:: max(1, len(known) // POSES)] for known in by_run])
    for pair, count in _pairs(model, q).items():
        touching = count / len(q)
        names = " and ".join(_geom_name(model, geom) for geom in pair)
        if touching >= TOUCHES:
            yield Finding(
                what="contact",
                words=(
                    f"{names} touch in {in_percent(touching)} of the motion, and"
                    " contacts are left out"
                ),
                remedy=(
                    "move clear of it, or exclude the pair in the model where they"
                    " only seem to touch"
                ),
                level="bad" if touching > TOUCHED else "fair",
            )


def _geom_name(model: Any, geom: int) -> str:
    body = model.body(model.geom_bodyid[geom])
    return model.geom(geom).name or f"a geom of {body.name}"


def _pairs(model: Any, q: Array) -> Counter[tuple[int, int]]:
    """Pairs of geoms that meet, each with the number of poses in which it does, among
    joint positions `q` with a row for each pose; bodies that belong together are left
    out.
    """
    colliding = copy.copy(model)
    off = mujoco.mjtDisableBit
    colliding.opt.disableflags &= ~int(off.mjDSBL_CONTACT | off.mjDSBL_CONSTRAINT)
    found: Counter[tuple[int, int]] = Counter()
    tied = _tied_bodies(model)
    for data in poses(colliding, q, mujoco.mj_fwdPosition):
        inside = {*map(tuple, data.contact.geom[data.contact.dist < 0.0])}
        found.update(
            pair for pair in inside if not _belong_together(model, tied, *pair)
        )
    return found


def _tied_bodies(model: Any) -> set[frozenset[int]]:
    """Pairs of the numbers of those bodies that an equality constraint of the `model`
    holds together.
    """
    found = set()
    both = np.stack([model.eq_obj1id, model.eq_obj2id], axis=1)
    for ends, of, kind in zip(both, model.eq_objtype, model.eq_type, strict=True):
        bodies = model.site_bodyid[ends] if of == mujoco.mjtObj.mjOBJ_SITE else ends
        if kind in HOLD:
            found.add(frozenset(model.body_weldid[bodies]))
    return found


def _belong_together(
    model: Any, tied: set[frozenset[int]], one: int, other: int
) -> bool:
    """Whether two geoms, given by number, lie on the same body, on bodies that an
    equality constraint ties, or on siblings or close neighbours in the tree of bodies.
    """
    if {model.geom_type[one], model.geom_type[other]} & {*UNBOUNDED}:
        return False
    a, b = (model.body_weldid[model.geom_bodyid[g]] for g in (one, other))
    above_a = _ancestors(model, a)
    above_b = _ancestors(model, b)
    siblings = above_a[0] == above_b[0] > 0
    near = a in (b, *above_b) or b in above_a
    return near or siblings or frozenset((a, b)) in tied


def _ancestors(model: Any, body: int) -> list[int]:
    """Numbers of the body that carries the given `body` and of the one that carries
    that, with -1 in place of the second where it is the world.
    """
    carriers = model.body_weldid[model.body_parentid]
    parent = carriers[body]
    return [parent, carriers[parent] or -1]
