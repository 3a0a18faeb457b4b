/* The serial port, lean enough for half a million baud: 320 cycles for each byte, there and back. Nothing here waits.
   Takes the place of the core's Serial, which must not be used beside it. */
#pragma once
#include <Arduino.h>
#include <avr/interrupt.h>

static const uint8_t RING = 128; /* bytes, a power of two; 2.5 ms at 500,000 baud */

static volatile uint8_t in_ring[RING], out_ring[RING];
static volatile uint8_t in_head = 0, in_tail = 0, out_head = 0, out_tail = 0; /* they run on to 255, then to 0 */

ISR(USART_RX_vect) {
  uint8_t byte = UDR0;
  if ((uint8_t)(in_head - in_tail) == RING) return; /* lost, and the check sum of its frame says so */
  in_ring[in_head % RING] = byte;
  in_head++;
}

ISR(USART_UDRE_vect) {
  if (out_tail == out_head) {
    UCSR0B &= (uint8_t)~_BV(UDRIE0);
    return;
  }
  UDR0 = out_ring[out_tail % RING];
  out_tail++;
}

static void begin_line(uint32_t baud) {
  UBRR0 = (uint16_t)((F_CPU / 4 / baud - 1) / 2);
  UCSR0A = _BV(U2X0);
  UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
  UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
}

static inline uint8_t waiting() { return in_head - in_tail; }

/* Take a byte; there must be one. */
static inline uint8_t take() {
  uint8_t byte = in_ring[in_tail % RING];
  in_tail++;
  return byte;
}

static inline uint8_t room() { return RING - (uint8_t)(out_head - out_tail); }

/* Put a byte behind those that wait; there must be room. `send` lets them go. */
static inline void put(uint8_t byte) {
  out_ring[out_head % RING] = byte;
  out_head++;
}

static inline void send() { UCSR0B |= _BV(UDRIE0); }
