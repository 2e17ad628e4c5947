"""`export`: gains for MATLAB, source code for other machines."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from obsdesign.cli.arguments import NUMBER, numbers, one_of
from obsdesign.cli.talk import say
from obsdesign.errors import InputError

if TYPE_CHECKING:
    from obsdesign.document import Design

# where each form goes if nothing is said
_OUTPUTS = {"mat": "gains.mat", "c": "code"}


@click.command()
@click.argument("design_file", metavar="DESIGN", type=click.Path())
@click.option("--to", "form", type=click.Choice(list(_OUTPUTS)), default="mat", show_default=True,
              help="mat: gains for MATLAB; c: C99 source with a self-test.")  # fmt: skip
@click.option("--precision", shell_complete=one_of("double", "float"),
              help="c: double or float.  [default: double]")  # fmt: skip
@click.option("--steps", metavar="H1,H2,…",
              help="c: lengths of the steps.  [default: the period of the samples]")  # fmt: skip
@click.option("--step-error", type=NUMBER, metavar="E",
              help="c: largest relative error of the length of a step.  [default: 0]")  # fmt: skip
@click.option("--prefix", metavar="NAME", help="c: what names in C begin with.  [default: obs]")
@click.option("-o", "--output", type=click.Path(),
              help="MATLAB file, or folder of the source.  [default: gains.mat; code]")  # fmt: skip
def export(
    *, design_file: str, form: str, precision: str | None, steps: str | None,
    step_error: float | None, prefix: str | None, output: str | None,
) -> int:  # fmt: skip
    """Write DESIGN for other programs: its gains to a MATLAB file, or the observer in C."""
    from obsdesign.design_file import load_design

    target = _OUTPUTS[form] if output is None else output
    options = {"--precision": precision, "--steps": steps, "--prefix": prefix}
    if form == "mat" and step_error is not None:
        options["--step-error"] = ""
    if form == "mat":
        for name, value in options.items():
            if value is not None:
                raise InputError(f"{name} belongs to --to c; a MATLAB file has none.")
        return _to_mat(design_file, target)
    design = load_design(design_file)
    given = {name: value for name, value in options.items() if value is not None}
    return _to_c(design, target, given, step_error or 0.0)


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


def _to_c(design: Design, output: str, options: dict[str, str], error: float) -> int:
    from obsdesign.export.folder import write_code
    from obsdesign.export.manifest import Options
    from obsdesign.export.precision import PRECISIONS
    from obsdesign.export.timing import Steps

    precision = options.get("--precision", "double")
    if precision not in PRECISIONS:
        raise InputError(f"--precision must be {' or '.join(PRECISIONS)}; got {precision!r}.")
    steps = options.get("--steps")
    lengths = () if steps is None else tuple(numbers(steps, "--steps"))
    chosen = Options(precision, Steps(lengths, error), options.get("--prefix", "obs"))
    names = write_code(design, output, chosen)
    p = chosen.prefix
    say(f"written: {output}/, {len(names)} files of kind {design.kind} in {precision}")
    say(f"test: cd {output} && cc -std=c99 -O2 {p}.c {p}_test.c -o {p}_test && ./{p}_test")
    return 0
