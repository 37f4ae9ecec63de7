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


def lengths() -> None:
    """Two numbers that may be removed, and a third setting."""
    import streamlit as st

    from stereocal.ui.fields import Number, begin_page, choose_from_menu, end_page, setting

    class Stored:
        settings = st.session_state.setdefault("stored", {"a": 2.0, "b": 0.5, "unit": "cm"})

        def keep_settings(self, values: dict[str, object]) -> None:
            self.settings.update(values)

    begin_page("lengths")
    for name in "ab":
        setting(Stored(), name, None, Number(0.0, or_none=True)).number_input(name)
    choose_from_menu(Stored(), "unit", "Unit", ("m", "cm"))
    end_page()


def stored(app: AppTest) -> dict[str, object]:
    return dict(app.session_state["stored"])


def test_what_did_not_reach_the_browser_is_not_taken_for_removed() -> None:
    """A browser that was told no values tells, with the next click, that of an empty page. Before,
    18 of 40 pages that were drawn anew a few times within seconds had lost both lengths."""
    app = AppTest.from_function(lengths).run()
    for number in app.number_input:
        number.set_value(None)
    app.run()
    assert stored(app) == {"a": 2.0, "b": 0.5, "unit": "cm"}
    assert [number.value for number in app.number_input] == [2.0, 0.5]
    assert app.selectbox[0].proto.default == 1  # that of an empty page is the stored one
    app.number_input[0].set_value(None).run()
    assert stored(app) == {"a": None, "b": 0.5, "unit": "cm"}
    app.number_input[0].set_value(3.0).run()
    assert stored(app)["a"] == 3.0
    assert not app.exception


def looks() -> None:
    """A choice of a view, or of none."""
    import streamlit as st

    from stereocal.ui.fields import begin_page, end_page, one_of, setting

    begin_page("looks")
    shown = setting(None, "view", None, one_of([None, "Tables"]))
    st.segmented_control("Look closer", ["Tables"], **shown.widget("default"))
    end_page()


def test_a_choice_of_nothing_is_taken_at_once() -> None:
    app = AppTest.from_function(looks).run()
    app.segmented_control(key="view").set_value("Tables").run()
    app.segmented_control(key="view").set_value(None).run()
    assert app.segmented_control(key="view").value is None
    assert app.session_state["fields_shown"]["view"] is None
    assert not app.exception
