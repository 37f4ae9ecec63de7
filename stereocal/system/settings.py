"""Settings, each described once, at its field: bounds, names, option, widget and JSON come from
there."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self, cast

from stereocal.errors import StereocalError
from stereocal.system.made_from import Parts
from stereocal.system.records import plain, settings_of

_ABOUT, _JOINED = "about", "joined"
INF = math.inf


@dataclass(frozen=True)
class About:
    """What is said of a setting."""

    title: str
    help: str
    low: float
    high: float
    choices: Mapping[str, str]
    """Each with its words."""
    option: str
    """On the command line, without the dashes; empty: as the field."""
    name: str
    """In a line of settings."""
    default: Any


def described(
    default: Any,
    title: str,
    text: str = "",
    *,
    between: tuple[float, float] = (0, 0),
    choices: Sequence[str] | Mapping[str, str] = (),
    option: str = "",
    name: str = "",
) -> Any:
    """The field of a setting: a number within bounds, a choice, a switch, or numbers of frames.

    Args:
        text: its help; without one it is neither an option nor in a form.
        choices: of a choice, with their words if these are others.
        name: in a line of settings; empty: the title.
    """
    name = name or f"{title[:1].lower()}{title[1:]}"
    words = (
        choices if isinstance(choices, Mapping) else {word: word.capitalize() for word in choices}
    )
    setting = About(title, text, *between, words, option, name, default)
    return field(default=default, metadata={_ABOUT: setting})


def joined(settings: type["Settings"]) -> Any:
    """The field of other settings, whose names stand among those of this class in JSON."""
    return field(default_factory=settings, metadata={_JOINED: settings})


def descriptions(settings: type["Settings"]) -> dict[str, About]:
    """What is said of each setting, of joined ones too, by its name."""
    parts = fields(cast(Any, settings))
    by_name = {part.name: part.metadata[_ABOUT] for part in parts if _ABOUT in part.metadata}
    for kind in _joined(settings).values():
        by_name = descriptions(kind) | by_name
    return by_name


def asked(settings: type["Settings"]) -> dict[str, About]:
    """The `descriptions` of options and forms."""
    return {name: setting for name, setting in descriptions(settings).items() if setting.help}


def _joined(settings: type["Settings"]) -> dict[str, type["Settings"]]:
    parts = fields(cast(Any, settings))
    return {part.name: part.metadata[_JOINED] for part in parts if _JOINED in part.metadata}


class Settings:
    """Settings that are checked when they are made; dataclasses derive from it."""

    def __post_init__(self) -> None:
        """Raise a `StereocalError` for a setting out of its bounds or none of its choices."""
        for name, setting in descriptions(type(self)).items():
            if (value := getattr(self, name, None)) is None:
                continue
            if setting.choices and value not in setting.choices:
                choices = " or ".join(setting.choices)
                raise StereocalError(f"{name} is {value!r}: it must be {choices}.")
            if setting.low < setting.high and not setting.low <= value <= setting.high:
                bounds = f"{setting.low:g} to {setting.high:g}"
                raise StereocalError(f"{name} is {value}: it must be from {bounds}.")

    def to_json(self) -> dict[str, Any]:
        """All settings in one flat object; infinity is written as the string "inf", since JSON has
        no infinity."""
        entries: dict[str, Any] = plain(self)
        content: dict[str, Any] = {}
        for name in _joined(type(self)):
            del entries[name]
            content |= getattr(self, name).to_json()
        content |= _exchanged(entries, INF, "inf")
        return content

    @property
    def parts(self) -> Parts:
        """The settings by their names in words."""
        names, values = descriptions(type(self)), self.to_json()
        return {setting.name: values[key] for key, setting in names.items()}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Self:
        """The settings that `to_json` describes; missing ones keep their defaults.

        Raises:
            StereocalError: a name is unknown, or a value is of another type or out of its bounds.
        """
        rest, others = _exchanged(dict(data), "inf", INF), {}
        own_names = {part.name for part in fields(cast(Any, cls))}
        for name, kind in _joined(cls).items():
            names = kind().to_json().keys() - own_names
            others[name] = kind.from_json({key: rest.pop(key) for key in names if key in rest})
        settings: Any = settings_of(rest, cls)
        return cast(Self, replace(settings, **others))


def _exchanged(value: Any, old: Any, new: Any) -> Any:
    """A plain value with `new` wherever `old` is."""
    if isinstance(value, dict):
        return {key: _exchanged(inner, old, new) for key, inner in value.items()}
    if isinstance(value, list):
        return [_exchanged(inner, old, new) for inner in value]
    return new if value == old else value
