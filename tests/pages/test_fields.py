"""Fields of forms store what the user sets, and nothing else."""

from streamlit.testing.v1 import AppTest


def page() -> None:
    """A form whose slider has the ends of the chosen data."""
    import streamlit as st

    from stereocal.ui.fields import Number, begin_page, choose, end_page, setting

    class Stored:
        settings = st.session_state.setdefault("stored", {"frames": 300})

        def keep_settings(self, values: dict[str, object]) -> None:
            self.settings.update(values)

    begin_page("form")
    stored = Stored()
    data = choose(stored, "data", "Data", ("long", "short"), tabs_own=False)
    most = 400 if data == "long" else 25
    frames = setting(stored, "frames", most - 5, Number(3, most))
    frames.number_input("Frames")
    frames.slider("The same")
    st.button("As a browser tells what it was given", on_click=frames.changed)
    end_page()


def test_a_look_at_other_data_leaves_a_number_that_does_not_fit_them() -> None:
    app = AppTest.from_function(page).run()
    slider = app.slider[0].key
    app.segmented_control(key="data").set_value("short").run()
    assert app.number_input[0].value == app.slider[0].value == 20
    assert app.slider[0].key != slider  # else Streamlit begins it anew at its lowest
    app.button[0].click().run()
    assert app.session_state["stored"]["frames"] == 300
    app.segmented_control(key="data").set_value("long").run()
    assert app.number_input[0].value == app.slider[0].value == 300
    app.slider[0].set_value(7).run()
    assert app.session_state["stored"]["frames"] == 7
    app.slider[0].set_value(300).run()
    assert app.session_state["stored"]["frames"] == 300
    assert not app.exception
