"""How the photographs of the two cameras are paired: the proposal, the other ways, the pairs.

`show_pairing(store)` is all that a page needs.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import pandas as pd
import streamlit as st

from stereocal.frames.decided_pairs import PairRow
from stereocal.frames.pairing import Alone, PhotographPair, short_names
from stereocal.frames.proposal import Proposal, Way
from stereocal.frames.slips import Slips
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.review import thumbnail
from stereocal.rig.camera import CAMERAS
from stereocal.system.numbers import count
from stereocal.ui import jobs
from stereocal.ui.fields import Field, one_of, setting
from stereocal.ui.holding import first_pairs
from stereocal.ui.messages import ErrorsShown, button, readable, show_with_button
from stereocal.ui.review import on_a_sheet
from stereocal.ui.texts import escape_markdown

TITLES: dict[Way, str] = {
    "name": "By name",
    "time": "By time",
    "order": "In order",
    "motion": "Started by hand",
}
FEW, ALL, NONE = "few", "all", "none"
MOST_SLIPS = 3


def show_pairing(store: ProjectPhotographs, search: Callable[[], object]) -> None:
    """The pairs of a project's photographs: how they were found, other ways, and how they look.

    Args:
        search: begins the search for the targets.
    """
    st.session_state.setdefault(ROUND, 0)
    proposal = store.proposal
    pairing = proposal.pairing
    if slips := readable(lambda: store.slips, warn=False):
        _show_found_slips(store, slips, search)
    else:
        sentence = f"{count(len(store.photographs), 'photograph')}. {pairing.sentence}"
        (st.success if pairing.complete else st.warning)(escape_markdown(sentence))
    _show_same(store)
    _show_ways(store, proposal)
    _show_slips(store, proposal)
    _show_pictures(store, proposal)
    edit_pairs(store)


def _show_same(store: ProjectPhotographs) -> None:
    """Pairs whose two photographs are one: those of one camera were given for both."""
    files, pairs = store.photographs, [row.pair for row in store.rows]
    same = [pair for pair in pairs if files.get(pair.primary) == files.get(pair.secondary)]
    if same:
        first, second = short_names([same[0].primary, same[0].secondary])
        words = (
            f"Both photographs are the same in {len(same)} of {len(pairs)} pairs, such as {first} "
            f"and {second}: those of one camera were given for both. Give each camera's own."
        )
        label = "Remove all photographs"
        show_with_button("warning", words, label, "pair_clear", store.clear)


def _change(act: Callable[..., object], *arguments: object) -> None:
    """Change the pairs, and have the table begin with them."""
    act(*arguments)
    forget_table()


def _way(store: ProjectPhotographs, proposal: Proposal) -> Field:
    """The way to pair, which the project stores as the user's choice."""

    def write(way: Way) -> None:
        _change(store.choose, replace(store.choice, way=way, later=None))

    return Field(
        "pair_way", "pair_way", lambda: store.proposal.way, write, fit=one_of(proposal.ways)
    )


def _show_ways(store: ProjectPhotographs, proposal: Proposal) -> None:
    choice = store.choice
    with st.container(horizontal=True, vertical_alignment="bottom"):
        if len(proposal.ways) > 1:
            counts = {way: len(pairing.pairs) for way, pairing in proposal.ways.items()}

            def titled(way: Way) -> str:
                proposed = ", proposed" * (way == proposal.best)
                return f"{TITLES[way]} ({counts[way]}{proposed})"

            _way(store, proposal).buttons("Pair the photographs", format_func=titled)
        if proposal.ways:
            turned = replace(choice, exchanged=not choice.exchanged, heard={}, later=None)
            label, act = "Exchange the cameras", partial(_change, store.choose, turned)
            button(label, "pair_exchange", act, icon="swap_horiz", type="tertiary")
        if store.can_undo_choice:
            button("Undo", "pair_undo", _change, store.undo_choice, icon="undo", type="tertiary")


def _show_slips(store: ProjectPhotographs, proposal: Proposal) -> None:
    """Photographs without a partner by the times, to be left out of the other ways by one press;
    and those that are left out."""
    choice, alone = store.choice, {photograph.name for photograph in proposal.pairing.alone}
    slips = [slip for slip in proposal.slips if proposal.way != "time" and slip.name not in alone]
    if slips:
        more = f" And {len(slips) - MOST_SLIPS} more." if len(slips) > MOST_SLIPS else ""
        what = "; ".join(map(str, slips[:MOST_SLIPS]))
        words = f"The times say otherwise: {what}.{more}"
        without = replace(choice, without=(*choice.without, *(slip.name for slip in slips)))
        label = f"Leave {'it' if len(slips) == 1 else 'them'} out"
        act = partial(_change, store.choose, without)
        show_with_button("warning", words, label, "pair_mend", act, first=True)
    if choice.without:
        with st.container(horizontal=True, vertical_alignment="center"):
            for name in choice.without:
                restored = replace(choice, without=tuple(o for o in choice.without if o != name))
                label = f"{escape_markdown(short_names([name])[0])} is left out: put it back"
                button(label, f"pair_back_{name}", _change, store.choose, restored, icon="undo")


def _show_found_slips(
    store: ProjectPhotographs, slips: Slips, search: Callable[[], object]
) -> None:
    """Photographs without a partner by the targets found, to be left out by one press, after which
    the targets are told apart again."""
    choice = store.choice
    without = replace(choice, way="order", without=(*choice.without, *slips.all))
    label = f"Leave {slips.it} out"

    def mend() -> None:
        _change(store.choose, without)
        search()

    words = f"{count(len(store.photographs), 'photograph')}, paired in order. {slips}"
    show_with_button("warning", words, label, "pair_mend_found", mend, first=True)


def _show_pictures(store: ProjectPhotographs, proposal: Proposal) -> None:
    """The pairs as pictures: few, all, or none once the targets are found."""
    pairs = [row.pair for row in store.rows]
    alone = proposal.pairing.alone
    # In order, which photographs have no partner is not known: the last ones are left.
    in_order = proposal.way == "order"
    items = [*pairs, *alone] if in_order else [*alone, *pairs]
    if not items:
        return
    usual = NONE if store.frames is not None else FEW
    field = setting(store.project, "pairs_shown", usual, one_of((FEW, ALL, NONE)), tabs_own=True)
    how = field.value()
    show = partial(_show_item, store, in_order)
    some = [*(() if in_order else alone[:MOST_SLIPS]), *first_pairs(pairs)]
    if how == FEW and len(some) < len(items):
        on_a_sheet(store.project, some, show, "pair_sheet")
        label = f"Show more ({len(items) - len(some)})"
        _button(field, label, ALL)
    elif how == NONE:
        _button(field, "Show the pairs", ALL)
    else:
        on_a_sheet(store.project, items, show, "pair_sheet")
        if len(some) < len(items):
            _button(field, "Show fewer", FEW)


def _button(field: Field, label: str, how: str) -> None:
    button(label, f"pairs_show_{how}", field.set, how, type="tertiary", icon="visibility")


def _show_item(store: ProjectPhotographs, ask: bool, item: PhotographPair | Alone) -> None:
    """Show the two photographs of a pair, or one without a partner.

    Args:
        ask: offer to leave either photograph of a pair out, for photographs that are paired in
            their order.
    """
    names: tuple[str | None, str | None]
    if isinstance(item, PhotographPair):
        names = item.primary, item.secondary
        alt = f"Both photographs of frame {item.frame}"
    else:
        names = (None, item.name) if item.camera == 1 else (item.name, None)
        alt = f"A photograph of the {CAMERAS[item.camera]} camera without a partner"
    st.image(thumbnail(store, names), width="stretch", alt=alt)
    titles = [escape_markdown(short_names([name])[0]) for name in names if name]
    if isinstance(item, Alone):
        st.markdown(f":orange-badge[:material/question_mark: no partner] {titles[0]}")
        return
    st.markdown(f"**Frame {item.frame}** · {titles[0]} · {titles[1]}")
    if ask:
        choice = store.choice
        with st.container(horizontal=True):
            for name, title in zip((item.primary, item.secondary), titles, strict=True):
                without = replace(choice, without=(*choice.without, name))
                label, act = f"Leave {title} out", partial(_change, store.choose, without)
                hint = f"{title} has no partner: those after it move up by one."
                button(label, f"pair_without_{name}", act, type="tertiary", help=hint)


COLUMNS = ("Use", "Frame", "Primary photograph", "Secondary photograph")
ROUND, _BASE, _ROWS = "photographs_round", "pairs_base", "pairs_known"


def edit_pairs(store: ProjectPhotographs) -> None:
    """The table to change pairs one by one."""
    rows = store.rows

    with st.expander("The pairs as a table, to change them"):
        edited = edited_rows(_table_of_pairs(store, rows))
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
        button("As they were found", "pair_again", _change, store.keep_rows, None, place=left)
        button("Remove all photographs", "no_photographs", clear, store, place=right)


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


def edited_rows(table: pd.DataFrame) -> list[PairRow]:
    """The edited pairs, without incomplete rows."""
    return [
        PairRow(PhotographPair(int(frame), str(primary), str(secondary)), use is not False)
        for use, frame, primary, secondary in table[list(COLUMNS)].itertuples(index=False)
        if pd.notna(frame) and pd.notna(primary) and pd.notna(secondary)
    ]


def clear(store: ProjectPhotographs) -> None:
    jobs.abandon(store.project, "photographs")  # first: a running job needs the photographs
    _change(store.clear)


def forget_table() -> None:
    """Have the editor begin with the stored pairs: a new key takes a new first table."""
    st.session_state[ROUND] += 1
