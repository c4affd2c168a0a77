/*
 * board.h: what the measuring program (main.c) needs of a board. No library of the compiler's vendor is used:
 * start-up, output and exit are in cortex_m.c, riscv.c or avr.c.
 */
#ifndef BOARD_H
#define BOARD_H

#include <stdint.h>

/* The ticks of the counter that are kept: it wraps at this number plus 1. */
extern const uint32_t board_ticks_mask;

/* A counter that runs up with the instructions (on AVR: with the clock cycles). */
uint32_t board_ticks(void);

/* Write one character to the computer that simulates the board. */
void board_put(char c);

/* End the simulation; status 0 says that main() came to its end. */
void board_exit(uint32_t status) __attribute__((noreturn));

/* Where the stack of the calling function ends. */
#if defined(__arm__)
#define BOARD_STACK_POINTER(p) __asm__ volatile("mov %0, sp" : "=r"(p))
#elif defined(__riscv)
#define BOARD_STACK_POINTER(p) __asm__ volatile("mv %0, sp" : "=r"(p))
#elif defined(__AVR__)
#define BOARD_STACK_POINTER(p) ((p) = (unsigned char *)(SP + 1U)) /* SP names the next free byte */
#include <avr/io.h>
#endif

#endif
