"""The simulated boards: compiler, flags, simulator, and how their counter of instructions is read.

QEMU counts instructions, not cycles: it knows no wait states and no pipeline. With ``-icount shift=N`` each
instruction takes 2**N ns of the board's clock, so a timer of the board counts them exactly: with shift=10 a
25 MHz SysTick makes 25.6 ticks per instruction. simavr counts clock cycles.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

COMMON = ("-std=c99", "-ffp-contract=off", "-ffreestanding")


@dataclass(frozen=True)
class Board:
    """A simulated board.

    Parameters
    ----------
    words : str
        What it is.
    packages : str
        Debian's packages of its tools.
    tools : str
        Prefix of its compiler: ``<tools>gcc``, ``<tools>size``.
    flags : tuple of str
        Of the compiler, besides ``COMMON``.
    link : tuple of str
        Of the linker; ``{start}`` is the folder of the start-up files.
    source : str
        Its start-up file.
    simulator : tuple of str
        Command; the program comes last.
    tick : Fraction
        Ticks of its counter per instruction (per cycle).
    empty : int
        Instructions (cycles) of a function that only returns 0.
    unit : str
        What is counted.
    memory : int
        Bytes of RAM where constants lie there too and fill it; 0 where they stay in flash.
    """

    words: str
    packages: str
    tools: str
    flags: tuple[str, ...]
    link: tuple[str, ...]
    source: str
    simulator: tuple[str, ...]
    tick: Fraction
    empty: int = 2
    unit: str = "instructions"
    memory: int = 0


def cortex_m(words: str, machine: str, flags: str, mhz: int, optimise: str = "-O2") -> Board:
    """Return a Cortex-M in QEMU, with semihosting.

    Parameters
    ----------
    words : str
    machine : str
        QEMU's name of the board.
    flags : str
        The processor, for gcc.
    mhz : int
        Clock of SysTick.
    optimise : str

    Returns
    -------
    board : Board
    """
    simulator = ("qemu-system-arm", "-M", machine, "-nographic", "-monitor", "none", "-serial", "none",
                 "-chardev", "stdio,id=s0", "-semihosting-config", "enable=on,target=native,chardev=s0",
                 "-icount", "shift=10,sleep=off", "-kernel")
    return Board(words, "gcc-arm-none-eabi qemu-system-arm", "arm-none-eabi-", (*flags.split(), "-mthumb", optimise),
                 ("-nostdlib", "-Wl,-T,{start}/cortex_m.ld", "-lgcc"), "cortex_m.c", simulator,
                 Fraction(1024 * mhz, 1000))


def risc_v(words: str, machine: str, abi: str) -> Board:
    """Return a 32-bit RISC-V in QEMU, machine virt, which counts instructions itself.

    Parameters
    ----------
    words, machine, abi : str
        ``machine`` and ``abi`` as gcc names them.

    Returns
    -------
    board : Board
    """
    simulator = ("qemu-system-riscv32", "-M", "virt", "-bios", "none", "-nographic", "-monitor", "none",
                 "-serial", "stdio", "-icount", "shift=0,sleep=off", "-kernel")
    return Board(words, "gcc-riscv64-unknown-elf qemu-system-misc", "riscv64-unknown-elf-",
                 (f"-march={machine}", f"-mabi={abi}", "-mcmodel=medany", "-O2"),
                 ("-nostdlib", "-Wl,-T,{start}/riscv.ld", "-lgcc"), "riscv.c", simulator, Fraction(1))


BOARDS = {
    "m3": cortex_m("Cortex-M3, no FPU (mps2-an385)", "mps2-an385", "-mcpu=cortex-m3", 25),
    "m4f": cortex_m("Cortex-M4F, float FPU (mps2-an386)", "mps2-an386",
                    "-mcpu=cortex-m4 -mfpu=fpv4-sp-d16 -mfloat-abi=hard", 25),
    "m7": cortex_m("Cortex-M7, double FPU (mps2-an500)", "mps2-an500",
                   "-mcpu=cortex-m7 -mfpu=fpv5-d16 -mfloat-abi=hard", 25),
    "m0": cortex_m("Cortex-M0, no FPU (microbit)", "microbit", "-mcpu=cortex-m0", 16, "-Os"),
    "rv32": risc_v("RISC-V rv32imac, no FPU (virt)", "rv32imac", "ilp32"),
    "rv32d": risc_v("RISC-V rv32imafdc, double FPU (virt)", "rv32imafdc", "ilp32d"),
    "avr": Board("ATmega2560, no FPU (simavr)", "gcc-avr avr-libc simavr", "avr-", ("-mmcu=atmega2560", "-Os"), (),
                 "avr.c", ("simavr", "-m", "atmega2560", "-f", "16000000"), Fraction(1), 7, "cycles", 8192),
}
