/*
 * Output and cycle counter of an ATmega2560 in simavr: its first serial port, timer 1, and sleep without
 * interrupts as the end. Start-up is avr-libc's.
 */
#include "board.h"

#include <avr/interrupt.h>
#include <avr/sleep.h>

const uint32_t board_ticks_mask = 0xFFFFFFFFU;

static volatile uint16_t overflows;

ISR(TIMER1_OVF_vect)
{
    overflows++;
}

void board_put(char c)
{
    while ((UCSR0A & (1U << UDRE0)) == 0U)
    {
    }
    UDR0 = (uint8_t)c;
}

void board_exit(uint32_t status)
{
    (void)status;
    cli();
    sleep_enable();
    sleep_cpu();
    for (;;)
    {
    }
}

uint32_t board_ticks(void)
{
    uint16_t high, low;

    cli();
    low = TCNT1;
    high = overflows;
    if (((TIFR1 & (1U << TOV1)) != 0U) && (low < 0x8000U))
    {
        high++;
    }
    sei();
    return ((uint32_t)high << 16) | low;
}

/* Before main(): the serial port and the timer, at the processor's clock. */
__attribute__((constructor)) static void board_start(void)
{
    UCSR0B = 1U << TXEN0;
    TIMSK1 = 1U << TOIE1;
    TCCR1B = 1U << CS10;
}

__attribute__((destructor)) static void board_stop(void)
{
    board_exit(0U);
}
