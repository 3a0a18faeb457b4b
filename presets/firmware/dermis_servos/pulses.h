/* Pulses for servos: one channel after the other, both edges timed to the tick by timer 1, one round each 20 ms.

   Each pulse carries the newest value at the moment it begins: holding all channels to one moment would make the last
   one 20 ms older than it need be. */
#pragma once
#include <Arduino.h>
#include <avr/interrupt.h>

static const uint8_t CHANNELS = DERMIS_CHANNELS;
static const uint8_t FIRST_PIN = 2;
static const uint16_t SHORTEST = 2000; /* timer ticks of 0.5 us: 1000 us */
static const uint16_t SPAN = 2000;     /* 1000 us more */
static const uint16_t SLOT = 40000u / CHANNELS; /* 2.5 ms a channel for eight of them, 20 ms for all */
static const uint16_t EARLY = 30;      /* ticks: the interrupt comes early and then waits, so that no other delays it. No
                                          longer: while it waits the port holds two bytes, and 41 us are too many */
static const uint8_t ROUND_HZ = 50;
static const uint8_t ROUND_MS = 20;

static volatile uint16_t ticks[CHANNELS];  /* of the next pulse, 0: this channel has none ... */
static volatile uint16_t counts[CHANNELS]; /* ... and the count that it stands for */
static volatile uint16_t pulsed[CHANNELS]; /* count of the last pulse that has begun */
static volatile bool pulsing = false;
static volatile uint8_t slots = 0; /* counted, so that others can see the interrupt live */
static volatile uint8_t *ports[CHANNELS];
static uint8_t masks[CHANNELS];
static uint8_t slot_channel = 0;
static bool high = false;
static uint16_t slot_start = 0, edge = 0;

ISR(TIMER1_COMPA_vect) {
  volatile uint8_t *port = ports[slot_channel];
  uint8_t mask = masks[slot_channel];
  bool starts = !high && pulsing && ticks[slot_channel];
  while ((int16_t)(TCNT1 - edge) < 0) {}
  if (starts) {
    *port |= mask;
    high = true;
    edge = slot_start + ticks[slot_channel];
    pulsed[slot_channel] = counts[slot_channel];
  } else {
    *port &= (uint8_t)~mask;
    high = false;
    slot_channel = (uint8_t)((slot_channel + 1) % CHANNELS);
    slot_start += SLOT;
    edge = slot_start;
    slots++;
  }
  OCR1A = edge - EARLY;
}

static void set_pulse(uint8_t channel, uint16_t value, uint16_t count) {
  uint8_t before = SREG;
  cli();
  ticks[channel] = value;
  counts[channel] = count;
  SREG = before;
}

static inline uint16_t last_pulse(uint8_t channel) {
  uint8_t before = SREG;
  cli();
  uint16_t count = pulsed[channel];
  SREG = before;
  return count;
}

static void begin_pulses() {
  for (uint8_t c = 0; c < CHANNELS; c++) {
    pinMode(FIRST_PIN + c, OUTPUT);
    digitalWrite(FIRST_PIN + c, LOW);
    ports[c] = portOutputRegister(digitalPinToPort(FIRST_PIN + c));
    masks[c] = digitalPinToBitMask(FIRST_PIN + c);
    ticks[c] = 0;
  }
  cli();
  TCCR1A = 0;
  TCCR1B = _BV(CS11); /* a tick is 8 clocks, 0.5 us */
  slot_start = edge = TCNT1 + SLOT;
  OCR1A = edge - EARLY;
  TIFR1 = _BV(OCF1A);
  TIMSK1 = _BV(OCIE1A);
  sei();
}
