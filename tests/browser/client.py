"""A session of the dashboard without a browser: the same protocol, for loads and crashes.

It does what Streamlit's page does in a browser: opens the websocket with the token of its page,
sends the state of the widgets, uploads files by HTTP, follows timers, and fetches downloads. It
draws nothing, so that what is measured is the server.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import parse_qs

import requests
from streamlit.proto.BackMsg_pb2 import BackMsg
from streamlit.proto.Element_pb2 import Element
from streamlit.proto.ForwardMsg_pb2 import ForwardMsg
from streamlit.proto.WidgetStates_pb2 import WidgetState
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

LONGEST_S = 120.0
_INTERNAL = "$$STREAMLIT_INTERNAL_KEY"
_TEXTS = ("markdown", "alert", "heading", "text", "exception", "progress", "spinner")


class PageError(Exception):
    """The page shows an exception, or never what was waited for."""


@dataclass
class _Drawn:
    element: Element
    run: str
    fragment: str


@dataclass
class Session:
    """One visitor of the dashboard at `url`.

    Raises:
        PageError: an exception stands on the page, or a wait has no end.
        OSError, websockets.exceptions.WebSocketException: the server is gone.
    """

    url: str
    timings: list[tuple[str, float]] = field(default_factory=list)
    """What was done, and after how many seconds the page stood."""

    def __post_init__(self) -> None:
        self.query = ""
        self.page = ""
        self._pages: dict[str, str] = {}
        self._states: dict[str, WidgetState] = {}
        self._drawn: dict[tuple[int, ...], _Drawn] = {}
        self._timers: dict[str, tuple[float, float]] = {}
        self._run, self._fragments = "", frozenset[str]()
        self._identity = ""
        self._running = False
        self._finished: int | None = None
        self._answer: Any = None
        self._http = requests.Session()
        # A server closes what was idle for 5 s; a browser tries again, this client does not.
        self._http.headers["Connection"] = "close"
        self._http.get(f"{self.url}/_stcore/health", timeout=30).raise_for_status()
        self.token = str(self._http.cookies["_streamlit_xsrf"])
        self._leave = ExitStack()
        connection = connect(
            self.url.replace("http", "ws", 1) + "/_stcore/stream",
            origin=Origin(self.url),
            subprotocols=[Subprotocol("streamlit"), Subprotocol(self.token)],
            additional_headers={"Cookie": f"_streamlit_xsrf={self.token}"},
            compression=None,
            max_size=None,
            open_timeout=60,
            close_timeout=1,
            ping_interval=None,
        )
        self._socket = self._leave.enter_context(connection)

    def close(self) -> None:
        """Leave, as by closing the tab."""
        self._leave.close()
        self._http.close()

    # What a person does

    def open(self, page: str = "", query: str = "", what: str = "") -> None:
        """Type an address: the last part, and the query without `?`."""
        self.query, self.page = query, page
        self._drawn.clear()
        self._states.clear()
        self._timers.clear()
        message = BackMsg()
        message.rerun_script.page_name = page
        self._rerun(message, what or f"open {page or 'start'}")

    def go(self, page: str) -> None:
        """Choose another page in the menu at the side."""
        self.page, self.query = page, ""
        self._timers.clear()
        self._states.clear()
        self._rerun(BackMsg(), f"open {page}")

    def press(self, key: str, what: str = "") -> None:
        """Press the button of this key."""
        self._act(self.id_of(key), what or f"press {key}", trigger_value=True)

    def type_number(self, key: str, value: float, what: str = "") -> None:
        """Type a number."""
        self._act(self.id_of(key), what or f"type {key}", double_value=value)

    def slide(self, key: str, value: float, what: str = "") -> None:
        """Move a slider."""
        state = WidgetState(id=self.id_of(key))
        state.double_array_value.data.append(value)
        self._send_state(state, what or f"slide {key}")

    def choose(self, key: str, option: str, what: str = "") -> None:
        """Choose one of the options that stand side by side."""
        state = WidgetState(id=self.id_of(key))
        state.string_array_value.data.append(option)
        self._send_state(state, what or f"choose {option}")

    def click(self, key: str, event: str, value: Mapping[str, Any], what: str) -> None:
        """What a component of ours sends."""
        identity = f"{_INTERNAL}_{self.id_of(key)}__events"
        self._act(identity, what, json_trigger_value=json.dumps({"event": event, "value": value}))

    def upload(self, key: str, files: Sequence[tuple[str, bytes]], what: str = "") -> None:
        """Give files to an uploader, whose key begins with `key`."""
        begun = time.monotonic()
        identity = self.id_of(key)
        places = self.addresses(key, [name for name, _ in files])
        state = WidgetState(id=identity)
        for (name, content), place in zip(files, places, strict=True):
            self._http.put(
                self.url + place.upload_url,
                files={"file": (name, content)},
                timeout=LONGEST_S,
                headers={"X-Xsrftoken": self.token},
            ).raise_for_status()
            info = state.file_uploader_state_value.uploaded_file_info.add(
                name=name, size=len(content), file_id=place.file_id
            )
            info.file_urls.CopyFrom(place)
        self._states[identity] = state
        self._rerun(BackMsg(), what or f"upload {key}", begun)

    def addresses(self, key: str, names: Sequence[str]) -> list[Any]:
        """Where files for an uploader go, as the server says: `upload_url` of each."""
        message = BackMsg()
        message.file_urls_request.request_id = self.id_of(key)
        message.file_urls_request.file_names.extend(names)
        self._answer = None
        self._socket.send(message.SerializeToString())
        self._until(lambda: self._answer is not None, "the addresses for an upload")
        return list(self._answer.file_urls)

    def download(self, key: str) -> bytes:
        """What the download button of this key gives."""
        begun = time.monotonic()
        identity = self.id_of(key)
        (button,) = (e.download_button for e in self.elements if e.download_button.id == identity)
        url = button.url or self._made(button.deferred_file_id)
        answer = self._http.get(self.url + url, timeout=LONGEST_S)
        answer.raise_for_status()
        self.timings.append((f"download {key}", time.monotonic() - begun))
        return answer.content

    def _made(self, file: str) -> str:
        """Where a file stands that the server makes only when it is asked for."""
        message = BackMsg()
        message.backend_operation_request.request_id = file
        message.backend_operation_request.session_id = self._identity
        message.backend_operation_request.deferred_file.file_id = file
        self._answer = None
        self._socket.send(message.SerializeToString())
        self._until(lambda: self._answer is not None, "a file to download")
        return str(self._answer.deferred_file.url)

    def wait_for(self, text: str, what: str = "", longest_s: float = LONGEST_S) -> None:
        """Wait until the page says so, while its timers go on."""
        begun = time.monotonic()
        self._until(lambda: text in self.text, f'"{text}"', longest_s)
        if what:
            self.timings.append((what, time.monotonic() - begun))

    def rest(self, seconds: float) -> None:
        """Do nothing for so long, while the page's timers go on."""
        end = time.monotonic() + seconds
        self._until(lambda: time.monotonic() >= end, "nothing", seconds + 1)

    # What a person sees

    @property
    def elements(self) -> Iterator[Element]:
        """All that stands on the page."""
        return (drawn.element for _, drawn in sorted(self._drawn.items()))

    @property
    def text(self) -> str:
        """All words of the page, without the signs of markup."""
        words = []
        for element in self.elements:
            kind = element.WhichOneof("type")
            if kind in _TEXTS:
                of = getattr(element, kind)
                words.append(getattr(of, "body", "") or getattr(of, "text", ""))
                words.append(getattr(of, "message", ""))
            elif kind is not None:
                words.append(str(getattr(getattr(element, kind), "label", "")))
        return "\n".join(words).replace("\\", "").replace("*", "")

    @property
    def project(self) -> str | None:
        """The id in the address."""
        found = parse_qs(self.query).get("project")
        return found[0] if found else None

    def has(self, key: str) -> bool:
        """Whether a widget of this key stands on the page."""
        return any(_is_key(identity, key) for identity in self._ids())

    def id_of(self, key: str) -> str:
        """The identity of a widget; the key may be a beginning."""
        found = [identity for identity in self._ids() if _is_key(identity, key)]
        found.sort(key=lambda identity: not identity.endswith(f"-{key}"))
        if not found:
            raise PageError(f"There is no {key} on the page {self.page}:\n{self.text}")
        return found[0]

    # The protocol

    def _ids(self) -> Iterator[str]:
        for element in self.elements:
            kind = element.WhichOneof("type")
            identity = getattr(getattr(element, kind), "id", "") if kind else ""
            if identity:
                yield identity

    def _act(self, identity: str, what: str, **value: Any) -> None:
        self._send_state(WidgetState(id=identity, **value), what)

    def _send_state(self, state: WidgetState, what: str) -> None:
        self._states[state.id] = state
        self._rerun(BackMsg(), what)

    def _rerun(self, message: BackMsg, what: str, begun: float | None = None) -> None:
        """Let the page be drawn anew, and wait until it stands."""
        begun = time.monotonic() if begun is None else begun
        self._until(lambda: not self._running, f"the end of what was before {what}")
        self._send_rerun(message)
        self._finished = None
        self._until(lambda: self._finished == ForwardMsg.FINISHED_SUCCESSFULLY, what)
        self.timings.append((what, time.monotonic() - begun))
        for identity in [name for name, state in self._states.items() if _is_trigger(state)]:
            del self._states[identity]

    def _send_rerun(self, message: BackMsg) -> None:
        rerun = message.rerun_script
        rerun.query_string = self.query
        if not rerun.page_name:
            rerun.page_script_hash = self._pages.get(self.page, "")
        rerun.widget_states.widgets.extend(self._states.values())
        self._socket.send(message.SerializeToString())

    def _until(self, done: Callable[[], bool], what: str, longest_s: float = LONGEST_S) -> None:
        end = time.monotonic() + longest_s
        while not done():
            now = time.monotonic()
            if now > end:
                raise PageError(f"Waited {longest_s:.0f} s for {what}. The page says:\n{self.text}")
            due = min((at for at, _ in self._timers.values()), default=min(now + 0.2, end))
            try:
                received = self._socket.recv(timeout=max(min(due, end) - now, 0.0))
            except TimeoutError:
                self._run_timers()
                continue
            message = ForwardMsg()
            message.ParseFromString(received if isinstance(received, bytes) else received.encode())
            self._take(message)
        self._check()

    def _run_timers(self) -> None:
        now = time.monotonic()
        for fragment, (at, interval) in list(self._timers.items()):
            if at <= now:
                self._timers[fragment] = (now + interval, interval)
                message = BackMsg()
                message.rerun_script.fragment_id = fragment
                message.rerun_script.is_auto_rerun = True
                self._send_rerun(message)

    def _take(self, message: ForwardMsg) -> None:
        kind = message.WhichOneof("type")
        if kind == "new_session":
            self._running, self._finished = True, None
            self._identity = message.new_session.initialize.session_id
            self._run = message.metadata.run.script_run_id
            self._fragments = frozenset(message.metadata.run.fragment_ids)
            if not self._fragments:
                self._timers.clear()
        elif kind == "navigation":
            self._pages = {p.url_pathname: p.page_script_hash for p in message.navigation.app_pages}
            current = message.navigation.page_script_hash
            self.page = next((n for n, h in self._pages.items() if h == current), self.page)
        elif kind == "page_info_changed":
            self.query = message.page_info_changed.query_string.removeprefix("?")
        elif kind in ("auto_rerun", "stop_auto_rerun"):
            self._set_timer(message)
        elif kind == "file_urls_response":
            self._answer = message.file_urls_response
        elif kind == "backend_operation_response":
            self._answer = message.backend_operation_response
        elif kind == "delta":
            self._draw(tuple(message.metadata.delta_path), message)
        elif kind == "script_finished":
            self._end(message.script_finished)

    def _set_timer(self, message: ForwardMsg) -> None:
        timer = message.auto_rerun
        if message.WhichOneof("type") == "auto_rerun":
            self._timers[timer.fragment_id] = (time.monotonic() + timer.interval, timer.interval)
        for fragment in message.stop_auto_rerun.fragment_ids:
            self._timers.pop(fragment, None)

    def _draw(self, path: tuple[int, ...], message: ForwardMsg) -> None:
        delta = message.delta
        if delta.WhichOneof("type") == "new_element":
            element = delta.new_element
            self._drawn[path] = _Drawn(element, self._run, delta.fragment_id)
            self._follow(element)
        elif delta.WhichOneof("type") == "add_block":
            self._drawn.pop(path, None)

    def _follow(self, element: Element) -> None:
        """Take over a value that the server has set."""
        kind = element.WhichOneof("type")
        widget = getattr(element, kind) if kind else None
        if widget is not None and getattr(widget, "set_value", False):
            state = WidgetState(id=widget.id)
            if kind == "number_input":
                state.double_value = widget.value
            elif kind == "slider" and not widget.raw_value:
                state.double_array_value.data.extend(widget.value)
            elif kind == "slider":
                state.string_array_value.data.extend(widget.raw_value)
            elif kind == "button_group":
                state.string_array_value.data.extend(widget.raw_values)
            elif kind == "selectbox":
                state.string_value = widget.raw_value
            elif kind == "checkbox":
                state.bool_value = widget.value
            else:
                return
            self._states[widget.id] = state

    def _end(self, status: int) -> None:
        """Forget what this run has not drawn again."""
        self._running, self._finished = False, status
        if status == ForwardMsg.FINISHED_EARLY_FOR_RERUN:
            return
        for path, drawn in list(self._drawn.items()):
            mine = not self._fragments or drawn.fragment in self._fragments
            if mine and drawn.run != self._run:
                del self._drawn[path]
        if not self._fragments:
            there = set(self._ids())
            for identity in [name for name in self._states if name not in there]:
                if not identity.startswith(_INTERNAL):
                    del self._states[identity]

    def _check(self) -> None:
        for element in self.elements:
            if element.WhichOneof("type") == "exception":
                raise PageError(f"{element.exception.type}: {element.exception.message}")


def _is_key(identity: str, key: str) -> bool:
    """Whether a widget's identity, `$$ID-<hash>-<key>`, has this key or one that begins so."""
    return identity.startswith("$$ID-") and identity.split("-", 2)[-1].startswith(key)


def _is_trigger(state: WidgetState) -> bool:
    return state.WhichOneof("value") in ("trigger_value", "json_trigger_value")
