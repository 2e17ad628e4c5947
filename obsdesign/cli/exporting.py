"""`export`: gains for MATLAB, source code for other machines."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from obsdesign.cli.arguments import NUMBER, numbers, one_of
from obsdesign.cli.talk import say
from obsdesign.errors import InputError

if TYPE_CHECKING:
    from obsdesign.export.manifest import Options

# where each form goes if nothing is said
_OUTPUTS = {"mat": "gains.mat", "c": "code", "fmu": "obs.fmu"}


@click.command()
@click.argument("design_file", metavar="DESIGN", type=click.Path())
@click.option("--to", "form", type=click.Choice(list(_OUTPUTS)), default="mat", show_default=True,
              help="mat: gains for MATLAB; c: C99 source with a self-test; "
              "fmu: an FMU for co-simulation.")  # fmt: skip
@click.option("--precision", shell_complete=one_of("double", "float"),
              help="c, fmu: double or float.  [default: double]")  # fmt: skip
@click.option("--steps", metavar="H1,H2,…",
              help="c, fmu: lengths of the steps.  "
              "[default: the period of the samples]")  # fmt: skip
@click.option("--step-error", type=NUMBER, metavar="E",
              help="c, fmu: largest relative error of the length of a step.  "
              "[default: 0]")  # fmt: skip
@click.option("--prefix", metavar="NAME",
              help="c, fmu: what names in C begin with.  [default: obs]")  # fmt: skip
@click.option("--fmi", "version", shell_complete=one_of("3.0", "2.0"),
              help="fmu: version of FMI, 3.0 or 2.0.  [default: 3.0]")  # fmt: skip
@click.option("-o", "--output", type=click.Path(),
              help="MATLAB file, folder of the source, or FMU.  "
              "[default: gains.mat; code; obs.fmu]")  # fmt: skip
def export(
    *, design_file: str, form: str, precision: str | None, steps: str | None,
    step_error: float | None, prefix: str | None, version: str | None, output: str | None,
) -> int:  # fmt: skip
    """Write DESIGN for other programs: gains to a MATLAB file, the observer in C or as an FMU."""
    target = _OUTPUTS[form] if output is None else output
    options = {
        "--precision": precision, "--steps": steps, "--prefix": prefix, "--step-error": step_error,
    }  # fmt: skip
    if form != "fmu":
        _refuse({"--fmi": version}, "fmu")
    if form == "mat":
        _refuse(options, "c and fmu")
        return _to_mat(design_file, target)
    chosen = _options(precision, steps, step_error, prefix)
    if form == "c":
        return _to_c(design_file, target, chosen)
    return _to_fmu(design_file, target, chosen, version or "3.0")


def _refuse(options: Mapping[str, object], forms: str) -> None:
    """InputError where an option is given that belongs to other forms."""
    for name, value in options.items():
        if value is not None:
            raise InputError(f"{name} belongs to --to {forms}.")


def _options(
    precision: str | None, steps: str | None, error: float | None, prefix: str | None
) -> Options:
    """What an export may choose, from the words of the options."""
    from obsdesign.export.manifest import Options
    from obsdesign.export.precision import PRECISIONS
    from obsdesign.export.timing import Steps

    precision = precision or "double"
    if precision not in PRECISIONS:
        raise InputError(f"--precision must be {' or '.join(PRECISIONS)}; got {precision!r}.")
    lengths = () if steps is None else tuple(numbers(steps, "--steps"))
    return Options(precision, Steps(lengths, error or 0.0), "obs" if prefix is None else prefix)


def _to_mat(design_file: str, output: str) -> int:
    from obsdesign.design_file import load_design
    from obsdesign.interop.export import save_mat
    from obsdesign.output_files import refuse_overwriting

    refuse_overwriting(output, design_file)
    if Path(output).suffix.lower() != ".mat":
        raise InputError(f"{output}: gains are exported to a file that ends in .mat.")
    design = load_design(design_file)
    save_mat(design, output)
    say(f"written: {output}, {len(design.gains)} gains of kind {design.kind}")
    return 0


def _to_c(design_file: str, output: str, options: Options) -> int:
    from obsdesign.design_file import load_design
    from obsdesign.export.folder import write_code

    design = load_design(design_file)
    names = write_code(design, output, options)
    p = options.prefix
    say(f"written: {output}/, {len(names)} files of kind {design.kind} in {options.precision}")
    say(f"test: cd {output} && cc -std=c99 -O2 {p}.c {p}_test.c -o {p}_test && ./{p}_test")
    return 0


def _to_fmu(design_file: str, output: str, options: Options, version: str) -> int:
    from obsdesign.design_file import load_design
    from obsdesign.export.compiler import machine
    from obsdesign.export.fmu import write_fmu
    from obsdesign.output_files import refuse_overwriting

    refuse_overwriting(output, design_file)
    if Path(output).suffix.lower() != ".fmu":
        raise InputError(f"{output}: an FMU is exported to a file that ends in .fmu.")
    design = load_design(design_file)
    reason = write_fmu(design, output, options, version)
    say(f"written: {output}, FMI {version}, kind {design.kind} in {options.precision}")
    if reason is None:
        say(f"with source, and a library for {'-'.join(machine())}")
    else:
        say(f"with source alone, which the importing tool compiles: {reason}")
    return 0
