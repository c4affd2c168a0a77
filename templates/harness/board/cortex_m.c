/*
 * Start-up, output and instruction counter of a Cortex-M in QEMU, by semihosting; no library.
 */
#include "board.h"

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define SYST_CSR REGISTER(0xE000E010U)
#define SYST_RVR REGISTER(0xE000E014U)
#define SYST_CVR REGISTER(0xE000E018U)
#define CPACR REGISTER(0xE000ED88U)
#define SYS_WRITEC 0x03U
#define SYS_EXIT_EXTENDED 0x20U
#define APPLICATION_EXIT 0x20026U

const uint32_t board_ticks_mask = 0xFFFFFFU;

int main(void);
void board_reset(void);

extern uint32_t board_bss[], board_bss_end[];
extern void board_stack_top(void); /* an address of the linker script, not a function */

static void semihost(uint32_t operation, const void *argument)
{
    register uint32_t r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;

    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
}

void board_put(char c)
{
    semihost(SYS_WRITEC, &c);
}

void board_exit(uint32_t status)
{
    const uint32_t block[2] = { APPLICATION_EXIT, status };

    semihost(SYS_EXIT_EXTENDED, block);
    for (;;)
    {
    }
}

uint32_t board_ticks(void)
{
    return 0xFFFFFFU - SYST_CVR; /* it counts down */
}

void board_reset(void)
{
    for (uint32_t *word = board_bss; word < board_bss_end; word++)
    {
        *word = 0U;
    }
#if defined(__ARM_FP)
    CPACR |= 0xFU << 20; /* before the first instruction of the FPU */
    __asm__ volatile("dsb\n\tisb" ::: "memory");
#endif
    SYST_RVR = 0xFFFFFFU;
    SYST_CVR = 0U;
    SYST_CSR = 5U; /* on, processor clock, no interrupt */
    board_exit((uint32_t)main());
}

static void fault(void)
{
    board_exit(3U);
}

/* Initial stack pointer, reset, NMI, HardFault and the other faults. */
__attribute__((section(".vectors"), used)) static void (*const vectors[16])(void) = {
    board_stack_top, board_reset, fault, fault, fault, fault, fault, fault,
    fault, fault, fault, fault, fault, fault, fault, fault,
};
