"""The correction network's file: weights with what they were trained by, on, and to what effect. JSON."""

import json
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np

from filters.correction.correction import CORE, Correction, Network, off
from gcs.contract.messages import InputError


class NetworkFile(msgspec.Struct, forbid_unknown_fields=True):
    """Arrays row by row, as in `correction.Network`."""

    w1: list[list[float]]
    b1: list[float]
    w2: list[list[float]]
    b2: list[float]
    limit: list[float]
    gain: list[float]
    training: dict  # settings and seeds
    data: dict  # flights it was trained, checked and tested on
    held_out: dict  # what it did on the flights held out


def save(path: Path, net: Network, training: dict, data: dict, held_out: dict) -> None:
    """Write a network, weights to 7 digits."""
    weights = {
        name: np.vectorize(lambda v: float(f"{v:.7g}"))(a).tolist() for name, a in net._asdict().items()
    }
    about = {"training": training, "data": data, "held_out": held_out}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(weights | about, indent=1) + "\n", encoding="utf-8")


def load(path: Path) -> Network:
    """Raises InputError with one line where the file is no such network."""
    try:
        file = msgspec.json.decode(path.read_bytes(), type=NetworkFile)
        net = Network(*(np.array(getattr(file, name), float) for name in Network._fields))
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; `gcs train` writes such files") from None
    except (msgspec.DecodeError, ValueError) as error:
        raise InputError(
            f"{path}: not a correction network: {error}; `gcs train` writes such files"
        ) from None
    h = net.b1.size
    shapes = [(h, CORE), (h,), (CORE, h), (CORE,), (CORE,), (CORE,)]
    for name, array, shape in zip(Network._fields, net, shapes, strict=True):
        if array.shape != shape:
            raise InputError(f"{path}: {name} has shape {array.shape}, expected {shape}")
    return net


def correction_of(text: str) -> Callable:
    """What ``--correction`` means: off, or the network in a file."""
    return off if text == "off" else Correction(load(Path(text)))
