"""Resample the two EMPS records from 1 kHz to 5 ms for the gallery plant ``emps``.

Run once, with numpy: ``python make_emps.py SRC_DIR``. SRC_DIR holds ``train.csv`` and ``test_pulses.csv``
with the columns ``t_s, qg_m, qm_m, vir_V, pulse_V`` (see README.md). Writes ``emps_train.csv`` and
``emps_pulses.csv`` beside this file; the same bytes every time.

Row k of the output is sample k of the observer, source rows 5k .. 5k+4:

=========  ===========================================================================================
command    V, mean over the step of vir_V - pulse_V: what the controller asked for; the pulse is not in it
position   m, encoder reading at the start of the step (source row 5k)
mode       mode that carries sample k to sample k+1, from the *reference* alone (see ``mode_of``)
actuator   V, label: mean over the step of pulse_V (5 while on; 1 and 4 in the steps of an edge)
=========  ===========================================================================================
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

STEP = 5  # source samples per step
PERIOD = 0.005  # s
SLOW = 0.02  # m/s: below this reference speed the direction of the carriage is not certain


def mode_of(speed: float) -> str:
    """Return the mode of a step from its mean reference speed.

    The carriage turns later than the reference: by 7 ms in all reversals of the training record, by 16 ms in
    one reversal of the other, where a pulse begins just as the reference turns. The sign of its speed, and
    with it the sign of the friction, is certain only while the reference moves fast enough: at 0.842 m/s^2
    the reference needs 24 ms from its turn to ``SLOW``.

    Parameters
    ----------
    speed : float
        Reference increment over the step divided by its duration, in m/s.

    Returns
    -------
    str
        ``"reversal"`` below ``SLOW``, else ``"forward"`` or ``"backward"``.

    """
    if abs(speed) < SLOW:
        return "reversal"
    return "forward" if speed > 0 else "backward"


def short(value: float, digits: int) -> str:
    """Print a number with at most ``digits`` decimals, without trailing zeros.

    Parameters
    ----------
    value : float
        The number.
    digits : int
        Most decimals to print.

    Returns
    -------
    str

    """
    text = f"{value:.{digits}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def resample(source: Path, target: Path) -> None:
    """Read one 1 kHz record, write it at 5 ms.

    Parameters
    ----------
    source : Path
        1 kHz record.
    target : Path
        File to write.

    """
    record = np.genfromtxt(source, delimiter=",", names=True)
    steps = (len(record) - 1) // STEP  # the reference one step on is needed for the mode
    reference = record["qg_m"][: steps * STEP + 1 : STEP]
    position = record["qm_m"][: steps * STEP : STEP]

    def mean(values: np.ndarray) -> np.ndarray:
        return values[: steps * STEP].reshape(steps, STEP).mean(axis=1)

    command, pulse = mean(record["vir_V"] - record["pulse_V"]), mean(record["pulse_V"])
    speed = np.diff(reference) / PERIOD
    lines = ["command,position,mode,actuator"]
    lines += [
        f"{short(command[k], 5)},{short(position[k], 9)},{mode_of(speed[k])},{short(pulse[k], 3)}"
        for k in range(steps)
    ]
    target.write_bytes(("\n".join(lines) + "\n").encode())


def main() -> int:
    """Resample both records.

    Returns
    -------
    int
        Exit status: 0 done, 2 usage.

    """
    if len(sys.argv) != 2:
        print("usage: make_emps.py SRC_DIR", file=sys.stderr)
        return 2
    source, here = Path(sys.argv[1]), Path(__file__).parent
    resample(source / "train.csv", here / "emps_train.csv")
    resample(source / "test_pulses.csv", here / "emps_pulses.csv")
    return 0


if __name__ == "__main__":
    sys.exit(main())
