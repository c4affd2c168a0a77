"""The compiled law with its observer, sample by sample: what stands in the loop with a plant."""

from __future__ import annotations

import numpy as np

from ..observers import FAMILIES
from ..observers.feedback import Command

Array = np.ndarray


class CompiledTracker:
    """The C of a unit; ``step`` answers as that of ``observers.feedback.Tracker`` with one run.

    Parameters
    ----------
    driver : Driver
        Of a folder with a law.
    """

    def __init__(self, driver):
        ffi, p = driver.ffi, driver.prefix
        self.driver, self.dtype = driver, np.dtype(driver.real)
        self.state, self.law, self.sample, self.out = (ffi.new(f"{p}_{name} *")
                                                       for name in ("state", "law", "in", "out"))
        self.call = {name: getattr(driver.lib, f"{p}_{name}") for name in ("track", "coast")}
        getattr(driver.lib, f"{p}_init")(self.state)
        getattr(driver.lib, f"{p}_law_init")(self.law)

    def step(self, ref: Array, y: Array) -> tuple[Command, object]:
        """One sample; a row of y with a NaN in it is a missing measurement, one that is refused becomes one.

        Parameters
        ----------
        ref : ndarray (1, k), y : ndarray (1, p)

        Returns
        -------
        command : Command
        answer : PolytopicTrace
            Of the observer at this sample.

        Raises
        ------
        ValueError
            A reference beyond its range.
        """
        ffi, sample, out = self.driver.ffi, self.sample, self.out
        held = ffi.new(f"{'float' if self.dtype == np.float32 else 'double'}[]", ref[0].astype(self.dtype).tolist())
        sample.y = y[0].astype(self.dtype).tolist()
        missing = bool(np.isnan(y).any())
        status = told = 3 if missing else self.call["track"](self.state, self.law, held, sample, out)
        if status == 3:
            status = self.call["coast"](self.state, self.law, sample, out)
        if status:
            raise ValueError("a reference is beyond its range")
        measured = told == 0
        answer = FAMILIES[self.driver.family].answers((1,), self.driver.record, self.dtype)
        answer.x_hat[0] = list(out.x_hat)
        if measured:
            answer.r[0], answer.r_bound[0] = list(out.r), list(out.r_bound)
        for name, value in (("alarm", out.alarm != 0), ("alarm_bits", out.alarm), ("latched_bits", out.latched),
                            ("raw_bits", out.raw), ("assured", out.assured), ("inside", out.inside),
                            ("settled", out.settled), ("status", 0 if missing else told)):
            getattr(answer, name)[0] = value
        command = Command(np.array([list(sample.u)], self.dtype), np.array([self.law.limited], np.uint32),
                          np.array([told]))
        return command, answer
