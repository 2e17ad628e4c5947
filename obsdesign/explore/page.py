"""The page of `explore`: a marimo notebook run as an app; --problem, --kind say of what."""

import marimo

app = marimo.App(width="full", app_title="obsdesign explore")


@app.cell
def _():
    import marimo as mo

    from obsdesign.explore.answer import answer, beside, brackets
    from obsdesign.explore.settings import (
        first_settings,
        labels_of,
        save,
        settings_of,
        with_values,
    )
    from obsdesign.problem.problem import load_for_kind

    stated = mo.cli_args().to_dict()
    source = str(stated["problem"])
    problem = load_for_kind(source, stated.get("kind"))[0]
    settings = settings_of(problem)
    return (
        answer,
        beside,
        brackets,
        first_settings,
        labels_of,
        mo,
        problem,
        save,
        settings,
        source,
        with_values,
    )


@app.cell
def _(first_settings, labels_of, mo, problem, settings):
    labels = labels_of(problem, settings)
    chosen = mo.ui.multiselect(
        options={label: key for key, label in labels.items()},
        value=[labels[key] for key in first_settings(settings)],
        label="numbers to change",
        full_width=True,
    )
    return chosen, labels


@app.cell
def _(chosen, labels, mo, settings):
    sliders = mo.ui.dictionary(
        {
            key: mo.ui.slider(
                steps=settings[key].stops,
                value=settings[key].value,
                label=labels[key],
                show_value=True,
                debounce=True,
                full_width=True,
            )
            for key in chosen.value
        }
    )
    return (sliders,)


@app.cell
def _(answer, mo, problem, sliders, with_values):
    from obsdesign.errors import InputError

    try:
        current, refusal = with_values(problem, sliders.value), ""
        shown = answer(current)
    except InputError as error:
        current, refusal, shown = None, str(error), None
    if shown is None:
        result = mo.callout(refusal, kind="danger")
    else:
        picture = mo.image(shown.picture, width="100%") if shown.picture else mo.md(shown.why)
        result = mo.vstack([mo.Html(shown.html), picture])
    return InputError, current, result


@app.cell
def _(beside, chosen, mo, problem, result, sliders):
    controls = mo.vstack([mo.md(f"### {problem.name}"), chosen, *sliders.values()])
    mo.Html(beside(controls.text, result.text))
    return


@app.cell
def _(mo, source):
    from pathlib import Path

    target = mo.ui.text(
        value=str(Path(source).with_stem(Path(source).stem + "_changed")),
        label="save the problem as",
        full_width=True,
    )
    button = mo.ui.run_button(label="save")
    return button, target


@app.cell
def _(beside, brackets, button, current, mo, target):
    limits = brackets(current) if current is not None else ""
    mo.Html(beside(mo.vstack([target, button]).text, limits))
    return


@app.cell
def _(InputError, button, mo, problem, save, sliders, source, target):
    mo.stop(not button.value)
    try:
        save(problem, sliders.value, source, target.value)
        said = mo.callout(f"written: {target.value}", kind="success")
    except (InputError, OSError) as failure:
        said = mo.callout(str(failure), kind="danger")
    mo.output.replace(said)
    return


if __name__ == "__main__":
    app.run()
