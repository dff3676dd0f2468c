"""Models come to the same bits whatever compiler, library and processor they meet."""

import re
import shlex
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
from scipy.integrate import DOP853, solve_ivp

from nrs_cosim.bus.mathematics import sine_and_cosine
from nrs_cosim.plant_fmu.bundled.builder import FLAGS, build
from nrs_cosim.plant_fmu.bundled.declaration import MODELS, bundled_models
from tests.cases import cases
from tests.plant_fmu.fmpy_instances import Open
from tests.plant_fmu.test_bundled_models import arm_acceleration

SHARED = {"-shared", "-fPIC", "-fvisibility=hidden", "-Werror"}
COMPILERS = {
    "gcc without optimisation": ("gcc", "-O0", ""),
    "gcc for this very processor": ("gcc", "-O3 -march=native", ""),
    "clang": ("clang", "-O3", ""),
    "zig": (f"{sys.executable} -m ziglang cc", "-O3", ""),
    "musl": ("musl-gcc", "-static", ""),
    "aarch64": ("aarch64-linux-gnu-gcc", "-static", "qemu-aarch64"),
}
"""Commands, their options, and what runs what they make."""
EXACT = {"frexp", "ldexp", "round", "sqrt"}
"""What IEEE 754 has one right result of."""
NO_NUMBERS = {
    *("calloc", "free", "malloc", "memcmp", "memcpy", "memmove", "memset"),
    *("snprintf", "strcmp", "strcpy", "vsnprintf", "stack_chk_fail"),
    *("cxa_finalize", "gmon_start", "ITM_registerTMCloneTable", "ITM_deregisterTMCloneTable"),
}
INTERVALS = 60
STIFF = (0, 1e-9, "stiff")
TERM = re.compile(r"([+-]?)\s*([0-9.e-]+) \* k([0-9]+)\[i\]")


def numbers(count: int) -> np.ndarray:
    """Return finite numbers of all sizes, and some that are hard to reduce."""
    rng = np.random.Generator(np.random.Philox(5))
    any_size = rng.integers(0, 2**64, count, np.uint64).view(float)
    near = np.arange(-40, 41) * np.pi / 2
    return np.concatenate(
        [
            any_size[np.isfinite(any_size)],
            rng.uniform(-10, 10, count),
            rng.uniform(-1e5, 1e5, count),
            *(near, np.nextafter(near, 9e9), np.ldexp(6381956970095103.0, [797])),
            [0.0, -0.0, 5e-324, 32767.99, 32768.0, -32768.0, 1.7976931348623157e308],
        ]
    )


NUMBERS = numbers(cases(100_000, 2_000))


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sources")
    with ZipFile(build("two_link_arm")) as archive:
        archive.extractall(folder)
    (folder / "sources" / "fmi3.c").unlink()
    shutil.copy(Path(__file__).with_name("same_bits.c"), folder / "sources")
    return folder / "sources"


def program(sources, compiler=("cc",), options=()):
    units = sorted(path.name for path in sources.glob("*.c") if path.name != "robot.c")
    flags = [flag for flag in FLAGS if flag not in SHARED]
    # The last of several -O counts.
    command = [*compiler, *flags, *options, *units, "-o", "same_bits", "-lm"]
    subprocess.run(command, cwd=sources, check=True, capture_output=True)
    return sources / "same_bits"


def run(path, *arguments, numbers=(), by=()):
    given = "\n".join(map(float.hex, numbers))
    command = [*by, path, *map(str, arguments)]
    done = subprocess.run(command, input=given, capture_output=True, text=True, check=True)
    *bits, evaluations = done.stdout.split()
    return np.array([int(word, 16) for word in bits], np.uint64).view(float), int(evaluations)


@pytest.fixture(scope="module")
def here(sources):
    """The program as models are compiled, by the name that it keeps."""
    return program(sources).rename(sources / "here")


def test_numpys_sin_and_cos_have_the_bits_of_the_models(here):
    found, _ = run(here, numbers=NUMBERS)
    both = found[: 2 * len(NUMBERS)].reshape(-1, 2).T
    assert np.array_equal(both.view(np.uint64), np.array(sine_and_cosine(NUMBERS)).view(np.uint64))
    few = np.array([sine_and_cosine(x) for x in NUMBERS[::97]]).T
    assert np.array_equal(few, both[:, ::97])


@pytest.mark.parametrize("name", COMPILERS)
def test_another_compiler_makes_models_of_the_same_bits(sources, here, name):
    compiler, options, emulator = map(shlex.split, COMPILERS[name])
    if not all(map(shutil.which, (compiler[0], *emulator))):
        pytest.skip(f"{shlex.join(compiler)} {shlex.join(emulator)} is not installed")
    if "ziglang" in compiler and not find_spec("ziglang"):
        pytest.skip("ziglang is not installed")
    other = program(sources, compiler, options)
    for arguments in ((), (5,), STIFF):
        ours, theirs = (
            run(here, *arguments, numbers=NUMBERS),
            run(other, *arguments, numbers=NUMBERS, by=emulator),
        )
        assert (ours[0].tobytes(), ours[1]) == (theirs[0].tobytes(), theirs[1])


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("model", bundled_models())
def test_a_model_asks_no_library_for_what_it_may_round_differently(unpacked, model, fmi):
    expect_own_mathematics(*unpacked(model, fmi).glob("binaries/*/*.so"))


def expect_own_mathematics(library):
    """Fail unless all that a shared library lacks is known to be exact, or to be no number."""
    if not shutil.which("nm"):
        pytest.skip("nm, of binutils, is not installed")
    command = ["nm", "-D", "--undefined-only", library]
    lacking = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    names = {
        line.split()[-1].split("@")[0].removesuffix("_chk").strip("_")
        for line in lacking.splitlines()
    }
    assert names <= EXACT | NO_NUMBERS


def test_right_hand_sides_are_fewer_and_errors_smaller_than_by_order_5(here):
    exact, _ = run(here, 8, 1e-14)
    (five, many), (eight, few) = run(here, 5), run(here, 8)
    assert few <= 90 * INTERVALS
    assert few <= 0.6 * many
    errors = [np.abs((found - exact) / (1 + np.abs(exact))).max() for found in (five, eight)]
    assert errors[1] <= 1e-10
    assert errors[1] < errors[0] <= 1e-9


def test_a_stiff_arm_is_integrated_by_the_implicit_method_within_the_tolerance(here):
    found, evaluations = run(here, *STIFF)
    explicit, many = run(here, 8, 1e-9, "stiff")
    assert evaluations <= 1000 * INTERVALS
    assert evaluations <= many / 5
    forced, _ = run(here, 10, 1e-9, "stiff")
    exact = stiff_by_radau(10)
    for states in (found, forced, explicit):
        rows = states.reshape(-1, 4)[:10, [0, 2, 1, 3]]
        assert np.abs((rows - exact) / (1 + np.abs(exact))).max() <= 2e-9


def stiff_by_radau(intervals):
    """Return q and qd of the stiff arm at the end of each interval, by its equations again."""
    light = {"m1": 0.01, "m2": 0.01, "J1": 1e-4, "J2": 1e-4}
    x, off, rows = np.array([0.4, 0.0, 0.0, -0.7]), 2.0, []

    def rates(t, x, eps, ups, since):
        e, ed = eps + (t - since) * ups - x[:2], ups - x[2:]
        disturbance = np.array([0.3 + 2 * np.sin(t), -0.2])
        force = 200 * e + 60 * ed + disturbance
        return np.concatenate([x[2:], arm_acceleration(x[:2], x[2:], force, **light)])

    for k in range(intervals):
        eps = np.array([0.1 * k + 0.9 * off, -0.05 * k - 0.7 * off])
        ups = np.array([1.0 - off, off - 0.5])
        given = eps, ups, 0.1 * k
        span = 0.1 * k, 0.1 * (k + 1)
        x = solve_ivp(rates, span, x, "Radau", args=given, rtol=1e-10, atol=1e-11).y[:, -1]
        rows.append(x)
        off *= 0.85
    return np.array(rows)


def test_the_method_of_order_8_has_the_coefficients_of_the_published_one():
    """scipy has them from the authors' program; that b integrates t^7 is checked beside."""
    text = (MODELS / "dop853.c").read_text("utf-8")
    rows = [
        {int(k) - 1: float(sign + c) for sign, c, k in TERM.findall(line)}
        for line in re.findall(r"= x\[i\] \+ h \* \((.*?)\);|double [ab] = (.*?);", text, re.DOTALL)
        for line in [line[0] or line[1]]
    ]
    *stages, b, e5, e3 = (np.array([row.get(i, 0.0) for i in range(12)]) for row in rows)
    nodes = [*map(float, re.findall(r"values, t \+ h \* ([0-9.]+),", text)), 1.0, 1.0]
    assert np.array_equal(stages, DOP853.A[1:12, :12])
    assert np.array_equal(nodes[:11], DOP853.C[1:12])
    assert np.array_equal([b, e5, e3], [DOP853.B, DOP853.E5[:12], DOP853.E3[:12]])
    c = np.array([0.0, *nodes[:11]])
    assert b @ c[:, None] ** np.arange(8) == pytest.approx(1 / np.arange(1, 9), rel=1e-14)


def test_the_integrator_is_a_parameter_and_one_that_is_none_is_refused(robot: Open):
    ends = []
    for order in (0.0, 8.0, 5.0):
        with robot("two_link_arm", 3) as arm:
            arm.initialize(integrator=order, qd=[1.0, -1.0])
            arm.fmu.doStep(0.0, 0.1)
            ends.append(arm.get("q").tolist())
    assert ends[0] == ends[1] != ends[2]
    assert ends[0] == pytest.approx(ends[2], rel=1e-9)
    with robot("two_link_arm", 3) as arm:
        assert arm.refuses(lambda: arm.initialize(integrator=7.0)) == (
            "integrator: expected 0, 5, 8 or 10, got 7"
        )
