"""A design as an FMU for co-simulation by FMI 3.0 or 2.0: source, descriptions, a library."""

from __future__ import annotations

import hashlib
import io
import os
import zipfile
from collections.abc import Mapping

from lmi.arithmetic.arrays import NewEntries
from obsdesign.document import Design
from obsdesign.errors import InputError
from obsdesign.export.compiler import library_suffix, machine, shared_library
from obsdesign.export.fmu_variables import Variable, Variables, plain
from obsdesign.export.manifest import Options
from obsdesign.export.source import Export, rendered
from obsdesign.output_files import write_bytes
from obsdesign.runtime.clocks.time_stamps import RELATIVE_TIME_TOLERANCE

VERSIONS = ("3.0", "2.0")
# names of machines in FMI 2.0
_MACHINES = {"linux": "linux64", "darwin": "darwin64", "windows": "win64"}
# types of FMI 3.0 that no variable has, and what they are in C
_OTHER_TYPES = (
    ("Int8", "int8_t"), ("UInt8", "uint8_t"), ("Int16", "int16_t"), ("UInt16", "uint16_t"),
    ("UInt32", "uint32_t"), ("Int64", "int64_t"), ("UInt64", "uint64_t"),
)  # fmt: skip
# of several FMUs in a process, none calls functions of another
_HIDDEN = "-fvisibility=hidden"
# files of an archive have no times: equal designs give equal bytes
_NO_TIME = (1980, 1, 1, 0, 0, 0)


def write_fmu(
    design: Design, path: str | os.PathLike[str], options: Options, version: str = "3.0"
) -> str | None:
    """Write a design as an FMU; return why it has no library, None where it has one.

    InputError for a design that cannot be exported, a version that is none, and where the file
    cannot be written.
    """
    _refuse(options, version)
    export = options.export(design)
    sources = _sources(export, version)
    contents = {f"sources/{name}": text.encode() for name, text in sources.items()}
    contents["modelDescription.xml"] = _rendered(
        f"fmi{version[0]}.xml.j2", export, version
    ).encode()
    if version == "3.0":
        contents["sources/buildDescription.xml"] = rendered("fmi3_build.xml.j2", export).encode()
    contents["resources/design.json"] = design.to_json().encode()
    reason = None
    try:
        contents[_library_name(export.prefix, version)] = shared_library(sources, _HIDDEN)
    except InputError as error:
        reason = str(error)
    write_bytes(path, _archive(contents))
    return reason


def _refuse(options: Options, version: str) -> None:
    if version not in VERSIONS:
        raise InputError(f"--fmi must be {' or '.join(VERSIONS)}; got {version!r}.")
    if version == "2.0" and options.precision != "double":
        raise InputError(
            f"--precision {options.precision}: FMI 2.0 has double alone; use --fmi 3.0."
        )


def _sources(export: Export, version: str) -> dict[str, str]:
    """Header and source of the observer, and the functions of FMI around it."""
    p = export.prefix
    return {
        f"{p}.h": rendered("observer.h.j2", export),
        f"{p}.c": rendered("observer.c.j2", export),
        f"{p}_fmu.c": _rendered("fmu.c.j2", export, version),
    }


def _rendered(template: str, export: Export, version: str) -> str:
    return rendered(template, export, **_context(export, version))


def _context(export: Export, version: str) -> NewEntries:
    """Words of the templates beside those of the source."""
    program = export.program
    variables = Variables(program, export.names, version)
    has_double = program.target.name == "double"
    steps = [repr(length) for length in program.timing.lengths]
    every = variables.all()
    parts = [("lower", program.sizes.n), ("upper", program.sizes.n)]
    if not program.has_bounds:
        parts = [("x", program.sizes.n), *([("d", program.q)] if program.q else [])]
    return {
        "fmi": version, "prefix_macro": f"FMI{version[0]}_FUNCTION_PREFIX",
        "token": _token(export, every), "description": _description(export),
        "model": plain(export.name), "variables": every, "units": _units(every),
        "estimate_parts": parts,
        "starts": len(variables.starts()), "inputs": len(variables.inputs()),
        "flags": variables.flags(), "settable_flags": len(variables.settable_flags()),
        "step_lengths": steps, "step_size": steps[0], "tolerance": repr(RELATIVE_TIME_TOLERANCE),
        "has_lengths": "true" if len(steps) > 1 else "false", "other_types": _OTHER_TYPES,
        "fmi_float": "Float64" if has_double else "Float32",
        "unset_float": "Float32" if has_double else "Float64",
        "unset_type": "float" if has_double else "double",
    }  # fmt: skip


def _description(export: Export) -> str:
    lengths = ", ".join(map(repr, export.program.timing.lengths))
    return (
        f"Observer of kind {export.program.kind}, design {export.digest}; "
        f"communication steps of {lengths}."
    )


def _token(export: Export, variables: list[Variable]) -> str:
    """What ties a description to its library: a hash of the observer and of all variables."""
    text = rendered("observer.c.j2", export) + repr(variables)
    return hashlib.sha256(text.encode()).hexdigest()


def _units(variables: list[Variable]) -> list[str]:
    return sorted({variable.unit for variable in variables if variable.unit is not None})


def _library_name(prefix: str, version: str) -> str:
    """Where a library for this machine is; InputError for a machine that has no name."""
    processor, system = machine()
    folder = f"{processor}-{system}"
    if version == "2.0":
        if system not in _MACHINES:
            raise InputError(f"FMI 2.0 has no name for {folder}.")
        folder = _MACHINES[system]
    return f"binaries/{folder}/{prefix}{library_suffix()}"


def _archive(contents: Mapping[str, bytes]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in contents.items():
            entry = zipfile.ZipInfo(name, _NO_TIME)
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, content)
    return stream.getvalue()
