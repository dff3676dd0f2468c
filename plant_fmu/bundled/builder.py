"""A model becomes an FMU: the same sources, flags and platform, the same bytes.

The archive holds the binary of this platform and all sources, and is kept in the user's
cache under a name that is keyed by what decides its bytes, the compiler excepted: of a bundled
model that is what it is made of, and the code that writes it.
"""

import functools
import hashlib
import shutil
from collections.abc import Mapping, Sequence
from glob import escape
from importlib.metadata import version
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from types import MappingProxyType
from uuid import NAMESPACE_OID, uuid5
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

from nrs_cosim.bus.text import nearest, quoted
from nrs_cosim.plant_fmu import cache, unit_names
from nrs_cosim.plant_fmu.bundled.compiler import (
    PLATFORMS,
    Platform,
    compiler,
    expect_zig,
    shared_library,
)
from nrs_cosim.plant_fmu.bundled.declaration import MODELS, Declaration, bundled_models, declaration
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.platform_names import FMI2, FMI3, LIBRARY

FLAGS = (
    *("-std=c99", "-shared", "-fPIC", "-O2", "-fvisibility=hidden"),
    # A processor that multiplies and adds in one would round otherwise; gcc 12 does so in pairs
    # of both, fp-contract or not, where it makes vectors of scalars for a processor that can.
    *("-ffp-contract=off", "-fno-tree-slp-vectorize"),
    *("-Wall", "-Wextra", "-Wpedantic", "-Werror"),
    "-Wno-strict-prototypes",  # clang finds some in the headers of FMI 3
)
_HEADERS = ("FunctionTypes.h", "Functions.h")
_PLATFORM_HEADER = {2: "fmi2TypesPlatform.h", 3: "fmi3PlatformTypes.h"}


def build(name: str, fmi: int = 3, platforms: Sequence[str] = ()) -> Path:
    """The FMU of the bundled model `name` for FMI 2 or 3, compiled unless it is in the cache.

    It has a library for this machine, or for the platforms that are asked for.

    The cache is `plant_fmu.cache`'s. `FmuError` says which models there are, which compiler is
    missing, or what it complained of.
    """
    if name not in bundled_models():
        known = bundled_models()
        raise FmuError(f"no bundled model {quoted(name)}{nearest(name, known)}")
    _expect_known(fmi)
    folder = MODELS / name
    made_of = {path.name: path.read_bytes() for path in (*folder.iterdir(), *MODELS.glob("*.*"))}
    written_by = (*Path(__file__).parent.glob("*.py"), Path(unit_names.__file__))
    made_by = {path.name: path.read_bytes() for path in written_by}
    origin = {**made_of, **made_by, **fmi_headers(fmi), "version": version("nrs-cosim").encode()}
    kept = _kept(name, fmi, origin, platforms)
    if path := cache.stored(kept):
        return path
    model, about = declaration(name, fmi), made_of["readme.md"].decode()
    files = _files(model, {"model.c": made_of["model.c"]}, fmi, about=about)
    return _compiled(kept, model.name, fmi, files, platforms)


def build_model(
    model: Declaration,
    equations: Mapping[str, bytes],
    fmi: int = 3,
    extra: Mapping[str, bytes] = MappingProxyType({}),
    about: str = "",
    without: Sequence[str] = (),
    platforms: Sequence[str] = (),
) -> Path:
    """The FMU of any model: its declaration, and C files that define what robot.h declares.

    `extra` are further files of the archive, which its token covers too; `about` is put before the
    table of variables that is its documentation. It goes `without` some of the C files that bundled
    models share.

    Where it is kept, and what can be wrong, is as for `build`.
    """
    _expect_known(fmi)
    files = _files(model, equations, fmi, extra, about, without)
    kept = _kept(model.name, fmi, files, platforms)
    return cache.stored(kept) or _compiled(kept, model.name, fmi, files, platforms)


def _expect_known(fmi: int) -> None:
    if fmi not in _PLATFORM_HEADER:
        raise FmuError(f"fmi: expected 2 or 3, got {fmi}")


def _kept(name: str, fmi: int, decides: Mapping[str, bytes], platforms: Sequence[str]) -> str:
    """The name in the cache of an FMU whose bytes these files decide."""
    targets = [PLATFORMS[platform].target for platform in sorted(set(platforms))]
    return f"{name}-fmi{fmi}-{_key(decides, targets)}.fmu"


def _compiled(
    kept: str, name: str, fmi: int, files: Mapping[str, bytes], platforms: Sequence[str]
) -> Path:
    """The FMU of all of its files but libraries, which are compiled."""
    wanted = [PLATFORMS[platform] for platform in sorted(set(platforms))]
    places: dict[str, Platform | None]
    places = {f"binaries/{p.folder(fmi)}/{name}{p.suffix}": p for p in wanted}
    if places:
        expect_zig()
    sources = {Path(f).name: text for f, text in files.items() if f.startswith("sources/")}
    libraries = {
        place: _compile(name, sources, platform)
        for place, platform in (places or {_binary_name(name, fmi): None}).items()
    }
    return cache.keep(kept, archive_bytes({**files, **libraries}))


def build_library(name: str, sources: Mapping[str, bytes]) -> Path:
    """The shared library of C files, beside FMI's headers of both versions; kept as FMUs are.

    `FmuError` is as for `build`.
    """
    files = {file: text for fmi in _PLATFORM_HEADER for file, text in fmi_headers(fmi).items()}
    files |= sources
    kept = f"{name}-{_key(files)}{LIBRARY}"
    return cache.stored(kept) or cache.keep(kept, _compile(name, files))


def write(name: str, fmi: int, destination: Path, platforms: Sequence[str] = ()) -> None:
    """Copies the FMU that `build` gives to the file `destination`."""
    copy_out(build(name, fmi, platforms), destination)


def copy_out(built: Path, destination: Path) -> None:
    """Copies a built FMU to where the user wants it; `FmuError` when it cannot be there."""
    try:
        destination.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(built, destination)
    except OSError as error:
        raise FmuError(f"{destination}: cannot be written: {error.strerror}") from error


def built_here(name: str, sha256: str) -> Path | None:
    """The FMU of that model name and digest among those that were built here, by any version."""
    kept = (cache.stored(kept, sha256) for kept in cache.names(f"{escape(name)}-fmi*.fmu"))
    return next(filter(None, kept), None)


def try_compiler() -> str:
    """Compile one function and say with what; `FmuError` as for `build`."""
    _compile("doctor", {"doctor.c": b"int one(void);\nint one(void) { return 1; }\n"})
    return f"{' '.join(compiler())} compiles"


def _files(
    model: Declaration,
    equations: Mapping[str, bytes],
    fmi: int,
    extra: Mapping[str, bytes] = MappingProxyType({}),
    about: str = "",
    without: Sequence[str] = (),
) -> dict[str, bytes]:
    """All of the archive but its binary. The token is a digest of these files without it."""
    # What writes them is not loaded for an FMU that is in the cache.
    from nrs_cosim.plant_fmu.bundled.c_source import c_header, c_tables  # noqa: PLC0415
    from nrs_cosim.plant_fmu.bundled.documentation import documentation  # noqa: PLC0415
    from nrs_cosim.plant_fmu.bundled.model_description import (  # noqa: PLC0415
        build_description,
        model_description,
    )

    other = f"fmi{5 - fmi}.c"
    shared = [path for path in MODELS.glob("*.[ch]") if path.name not in {other, *without}]
    sources = {path.name: path.read_bytes() for path in shared} | dict(equations)
    sources |= fmi_headers(fmi) | {"variables.c": c_tables(model).encode()}
    units = sorted(name for name in sources if name.endswith(".c"))
    if fmi == 3:
        sources["buildDescription.xml"] = build_description(model, units)
    known = {f"sources/{name}": text for name, text in sources.items()}
    known |= documentation(model, about) | dict(extra)

    def with_token(token: str) -> dict[str, bytes]:
        return {
            **known,
            "modelDescription.xml": model_description(model, fmi, token, units),
            "sources/variables.h": c_header(model, token).encode(),
        }

    return with_token(str(uuid5(NAMESPACE_OID, _digest(with_token("")))))


def fmi_headers(fmi: int) -> dict[str, bytes]:
    """FMI's headers of version 2 or 3, by name."""
    names = [f"fmi{fmi}{suffix}" for suffix in _HEADERS] + [_PLATFORM_HEADER[fmi]]
    return {name: (_vendor() / name).read_bytes() for name in names}


@functools.cache
def _vendor() -> Path:
    """Where FMPy has them, which is not loaded for that."""
    fmpy = find_spec("fmpy")
    assert fmpy is not None
    return Path(str(fmpy.origin)).parent / "c-code"


def _digest(files: dict[str, bytes]) -> str:
    digest = hashlib.sha256()
    for name, text in sorted(files.items()):
        digest.update(f"{name}\0{len(text)}\0".encode() + text)
    return digest.hexdigest()


def _key(files: Mapping[str, bytes], targets: Sequence[str] = ()) -> str:
    platform = " ".join(targets) or FMI3
    decides = {**files, "flags": " ".join(FLAGS).encode(), "platform": platform.encode()}
    return _digest(decides)[:16]


def _binary_name(name: str, fmi: int) -> str:
    folder = FMI2 if fmi == 2 else FMI3
    return f"binaries/{folder}/{name}{LIBRARY}"


def _compile(name: str, sources: Mapping[str, bytes], platform: Platform | None = None) -> bytes:
    """The shared library of C files that are ours."""
    units = sorted(file for file in sources if file.endswith(".c"))
    return shared_library(name, sources, units, FLAGS, platform)


def archive_bytes(files: Mapping[str, bytes]) -> bytes:
    """An archive of files, the same bytes of the same files."""
    written = BytesIO()
    with ZipFile(written, "w") as archive:
        # Neither a date, nor a system, nor an order of this machine's is in the bytes.
        for name in sorted(files):
            entry = ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
            entry.compress_type = ZIP_DEFLATED
            entry.create_system = 3
            entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            archive.writestr(entry, files[name], compresslevel=9)
    return written.getvalue()
