"""`obsdesign export`: gains of a design for other programs."""

from __future__ import annotations

from pathlib import Path

import click

from obsdesign.errors import InputError


@click.command()
@click.argument("design_file", metavar="DESIGN")
@click.option("-o", "--output", default="gains.mat", show_default=True, help="MATLAB file.")
def export(design_file: str, output: str) -> int:
    """Write the gains and the plant of DESIGN to a MATLAB file."""
    if Path(output).suffix.lower() != ".mat":
        raise InputError(f"{output}: gains are exported to a file that ends in .mat.")
    from obsdesign.document import load_design, refuse_overwriting
    from obsdesign.interop.export import save_mat

    refuse_overwriting(output, design_file)
    design = load_design(design_file)
    save_mat(design, output)
    click.echo(f"written: {output}, {len(design.gains)} gains of kind {design.kind}")
    return 0
