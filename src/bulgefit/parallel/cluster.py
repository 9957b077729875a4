"""Who works on a Dask cluster? Workers that are as this process is, while its scheduler answers."""

from __future__ import annotations

import logging
import platform
import socket
import struct
import time
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, Executor
from contextlib import contextmanager, suppress
from importlib.metadata import PackageNotFoundError, version
from typing import Any
from urllib.parse import urlsplit

from bulgefit.errors import InputError

__all__ = ["asked", "client_of", "comes_back", "is_there", "line_of", "opened"]

#: Seconds within which a scheduler answers and has a worker.
PATIENCE = 10.0

#: The packages on which the bits of a result depend.
_PACKAGES = ("bulgefit", "numpy", "scipy", "numba")


@contextmanager
def opened(scheduler: str) -> Iterator[Executor]:
    """An executor of the workers of a scheduler, until the block ends.

    Parameters
    ----------
    scheduler : str
        Its address, tcp://host:port.

    Raises
    ------
    InputError
        See `open_executor`.
    """
    with _dask_is_quiet():
        client = _connected(scheduler)
        try:
            yield client.get_executor(pure=False)
        finally:
            client.close()


def client_of(executor: Executor) -> Any:
    """The Dask client behind an executor, or None."""
    client = getattr(executor, "_client", None)  # Client.get_executor() has no public name for it
    return client if hasattr(client, "scatter") else None


def line_of(executor: Executor) -> object:
    """What is another object after a cluster's scheduler was lost and found again; else the same.

    All that it had been asked for is lost then, and its client does not say so of everything.
    """
    return getattr(client_of(executor), "scheduler_comm", None)


def is_there(executor: Executor, seconds: float) -> bool:
    """Whether the scheduler of a cluster answers in so many seconds; its client may not notice.

    Executors of this machine cancel what they lose.
    """
    client = client_of(executor)
    if client is None:
        return True
    if client.status != "running":
        return False
    place = urlsplit(client.scheduler.address)
    if place.scheme not in ("tcp", "tls"):
        return True
    try:
        with socket.create_connection((place.hostname, place.port), seconds):
            return True
    except OSError:
        return False


@contextmanager
def asked(client: Any) -> Iterator[None]:
    """Ask a scheduler for something in the block, which may be gone or go just then.

    Raises
    ------
    BrokenExecutor
        It is, as an executor of this machine says it.
    """
    lost = BrokenExecutor("the scheduler was lost")
    if client.status == "closed":
        raise lost
    try:
        yield
    except OSError as error:  # Dask's own errors of connections and of time are such
        raise lost from error
    except Exception as error:
        if client.status == "closed":
            raise lost from error
        raise


def comes_back(executor: Executor) -> bool:
    """Whether a scheduler that was lost answers again within `PATIENCE`, and has workers.

    What restarts one that ended does so in seconds. It knows nothing of what it was asked.

    Raises
    ------
    InputError
        It has no workers within `PATIENCE`, or they are not as this process is.
    """
    client = client_of(executor)
    until = time.monotonic() + PATIENCE
    while client.status != "closed" and time.monotonic() < until:
        # its client connects again by itself
        if client.status == "running" and is_there(executor, PATIENCE):
            with suppress(BrokenExecutor), asked(client):
                _check_workers(client, client.scheduler.address)
                return True
        time.sleep(0.1)
    return False


@contextmanager
def _dask_is_quiet() -> Iterator[None]:
    """No tracebacks in Dask's log: what goes wrong is told by our errors."""
    with suppress(ImportError):
        import distributed  # noqa: F401  (sets the levels of its loggers when first imported)
    names = ("distributed.client", "distributed.utils", "tornado.application")
    loggers = [logging.getLogger(name) for name in names]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def _connected(address: str) -> Any:
    """A client of the scheduler, whose workers have the packages of this process."""
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            "a scheduler needs the package distributed: pip install 'bulgefit[cluster]'"
        ) from None
    _check_answer(address)
    try:
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except Exception as error:
        raise InputError(f"scheduler {address}: no Dask scheduler answers there") from error
    try:
        _check_workers(client, address)
    except BaseException:
        client.close()
        raise
    return client


def _check_answer(address: str) -> None:
    """Refuse an address where nothing speaks as a Dask scheduler does.

    Asked here, since a client of Dask that finds none complains on its own later on.
    """
    parts = urlsplit(address)
    try:
        port = parts.port
    except ValueError:
        port = None
    if parts.scheme not in ("tcp", "tls") or not parts.hostname or not port:
        raise InputError(f"scheduler {address!r}: give its address as tcp://host:port")
    try:
        with socket.create_connection((parts.hostname, port), PATIENCE) as line:
            if parts.scheme == "tcp":
                # it speaks first: how many frames its greeting has, in eight bytes
                greeting = line.recv(8, socket.MSG_WAITALL)
                if len(greeting) < 8 or struct.unpack("<Q", greeting)[0] > 100:
                    raise OSError("something else answers")
    except OSError as error:
        raise InputError(
            f"scheduler {address}: no Dask scheduler answers there ({error.strerror or error}); "
            "start one with `dask scheduler`, and name the address it prints"
        ) from error


def _check_workers(client: Any, address: str) -> None:
    """Refuse a scheduler without workers, and workers that would give other bits."""
    from distributed import TimeoutError as NoWorkers  # not the builtin one before Python 3.11

    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except NoWorkers:
        raise InputError(
            f"scheduler {address}: it has no workers; start some with `dask worker {address}`"
        ) from None
    ours = _versions()
    try:
        theirs = client.run(_versions)
    except ImportError as error:
        raise InputError(
            f"scheduler {address}: its workers cannot load bulgefit ({error}); install there what "
            "is installed here"
        ) from error
    for worker, found in theirs.items():
        other = [f"{k} {found[k]} (here {ours[k]})" for k in ours if found[k] != ours[k]]
        if other:
            raise InputError(
                f"scheduler {address}: worker {worker} has {', '.join(other)}; install there what "
                "is installed here, or results would differ"
            )


def _versions() -> dict[str, str]:
    python = ".".join(platform.python_version_tuple()[:2])
    return {"python": python, **{name: _version(name) for name in _PACKAGES}}


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:  # run from its sources without being installed
        return "not installed"
