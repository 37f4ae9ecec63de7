"""The table of photograph pairs on the Data page."""

from collections.abc import Sequence

import pandas as pd
import streamlit as st

from stereocal.frames.pairing import Pair
from stereocal.projects.pair_rows import PairRow
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.ui import jobs
from stereocal.ui.messages import ErrorsShown, callback

COLUMNS = ("Use", "Frame", "Primary photograph", "Secondary photograph")
ROUND, _BASE, _ROWS = "photographs_round", "pairs_base", "pairs_known"


def edit_pairs(store: ProjectPhotographs) -> None:
    """The table to change pairs one by one."""
    rows = store.rows

    @callback
    def pair_again() -> None:
        store.keep_rows(None)
        forget_table()

    with st.expander("The pairs as a table, to change them"):
        edited = rows_of(_table_of_pairs(store, rows))
        known: Sequence[PairRow] = st.session_state[_ROWS]
        with ErrorsShown(lambda why: st.error(f"{why} The last sound table is kept.")):
            if edited != known:
                store.keep_rows(edited)
                st.session_state[_ROWS] = edited
                st.rerun()
            elif known != rows:  # other pairs were stored
                forget_table()
                st.rerun()
        st.caption(f"{sum(row.use for row in rows):,} of {len(rows):,} pairs are used.")
        left, right = st.columns(2)
        left.button("As they were found", on_click=pair_again, key="pair_again")
        right.button("Remove all photographs", on_click=clear, args=(store,), key="no_photographs")


def _table_of_pairs(store: ProjectPhotographs, rows: Sequence[PairRow]) -> pd.DataFrame:
    # The editor applies changes to its first table, which must stay the same while it is shown.
    key = f"pairs_{st.session_state[ROUND]}"
    if key not in st.session_state or _BASE not in st.session_state:
        st.session_state[_BASE], st.session_state[_ROWS] = table_of(rows), list(rows)
    column, names = st.column_config, sorted(store.photographs)
    photograph = column.SelectboxColumn(options=names, required=True)
    base: pd.DataFrame = st.session_state[_BASE]
    edited: pd.DataFrame = st.data_editor(
        base,
        key=key,
        num_rows="dynamic",
        hide_index=True,
        column_config={
            "Use": column.CheckboxColumn(default=True, width="small"),
            "Frame": column.NumberColumn(step=1, width="small", required=True),
            **dict.fromkeys(COLUMNS[2:], photograph),
        },
    )
    return edited


def table_of(rows: Sequence[PairRow]) -> pd.DataFrame:
    """The pairs as the editor shows them."""
    content = [(row.use, row.pair.frame, row.pair.primary, row.pair.secondary) for row in rows]
    table = pd.DataFrame(content, columns=list(COLUMNS))
    return table.astype({"Use": bool, "Frame": "Int64", COLUMNS[2]: object, COLUMNS[3]: object})


def rows_of(table: pd.DataFrame) -> list[PairRow]:
    """The edited pairs, without incomplete rows."""
    return [
        PairRow(Pair(int(frame), str(primary), str(secondary)), use is not False)
        for use, frame, primary, secondary in table[list(COLUMNS)].itertuples(index=False)
        if pd.notna(frame) and pd.notna(primary) and pd.notna(secondary)
    ]


@callback
def clear(store: ProjectPhotographs) -> None:
    jobs.abandon(store.project, "photographs")  # first: a running job needs the photographs
    store.clear()
    forget_table()


def forget_table() -> None:
    """Have the editor begin with the stored pairs: a new key takes a new first table."""
    st.session_state[ROUND] += 1
