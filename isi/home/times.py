"""Times as the database of a home holds them."""

from datetime import UTC, datetime, timedelta

from isi.errors import InputError


def now() -> datetime:
    """The time of a change that gives none: in UTC, to the second."""
    return datetime.now(UTC).replace(microsecond=0)


def as_text(time: datetime) -> str:
    """A time in UTC, to the second, so that texts order as times do."""
    return f"{time.astimezone(UTC).replace(microsecond=0, tzinfo=None).isoformat()}Z"


def time_before(age: timedelta, since: datetime | None = None) -> str:
    """The text of a time some age before another one; None: now."""
    try:
        return as_text((since or now()) - age)
    except OverflowError as error:
        raise InputError("age", "", f"expected fewer years, got {age}") from error


def as_seconds(text: str) -> int:
    """A text of ``as_text`` as seconds since 1970, which take less room."""
    return int(datetime.fromisoformat(text).timestamp())


def of_seconds(seconds: int) -> str:
    """The text of seconds since 1970."""
    return as_text(datetime.fromtimestamp(seconds, UTC))
