"""The dashboard: `streamlit run app.py`. Page settings and st.navigation, nothing else."""

from pathlib import Path


def main() -> None:
    """Draw the frame and run the chosen page.

    The imports stand here because a child process that reads a file imports this module.
    """
    import streamlit as st

    from stereocal.ui.menu import show_menu, title_shown

    icon = Path(__file__).parent / "assets" / "icon.png"
    st.set_page_config(page_title="stereocal", page_icon=str(icon), layout="wide")
    page = show_menu()
    with title_shown(page):
        from stereocal.ui.navigation import check_settings, run_page
        from stereocal.ui.project import keep_address
        from stereocal.ui.warm_up import WARM_UP
    check_settings()
    WARM_UP.start()
    keep_address()
    run_page(page)


if __name__ == "__main__":
    main()
