/*
 * Start-up, output and instruction counter of a RISC-V in QEMU (machine virt): its serial port, its power
 * switch and minstret; no library.
 */
#include "board.h"

#define UART (*(volatile uint8_t *)0x10000000U)
#define POWER (*(volatile uint32_t *)0x100000U)
#define FLOATING_POINT_ON 0x2000U /* mstatus.FS = initial */

const uint32_t board_ticks_mask = 0xFFFFFFFFU;

int main(void);
void board_reset(void);
void board_start(void);
void board_fault(void);

void board_put(char c)
{
    UART = (uint8_t)c;
}

void board_exit(uint32_t status)
{
    POWER = (status == 0U) ? 0x5555U : ((status << 16) | 0x3333U);
    for (;;)
    {
    }
}

/* The extension zicsr is named here and not by -march, which chooses the compiler's library. */
uint32_t board_ticks(void)
{
    unsigned long count;

    __asm__ volatile(".option push\n\t.option arch, +zicsr\n\tcsrr %0, minstret\n\t.option pop" : "=r"(count));
    return (uint32_t)count;
}

__attribute__((aligned(4))) void board_fault(void)
{
    board_exit(3U);
}

/* With a stack; the variables are zero, because QEMU starts with empty memory. */
void board_start(void)
{
    __asm__ volatile(".option push\n\t.option arch, +zicsr\n\tcsrs mstatus, %0\n\tcsrw mtvec, %1\n\t.option pop"
                     : : "r"(FLOATING_POINT_ON), "r"(board_fault));
    board_exit((uint32_t)main());
}

__attribute__((naked, section(".vectors"), used)) void board_reset(void)
{
    __asm__ volatile("la sp, board_stack_top\n\tj board_start");
}
