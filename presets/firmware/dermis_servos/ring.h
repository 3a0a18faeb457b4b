/* Bytes between an interrupt and the loop: one of them puts, the other takes, and neither waits. */
#pragma once
#include <stdint.h>

/* An index must be read and written at once: up to 128 bytes it has 8 bits, for chips whose memory has no more. */
template <bool small> struct RingIndex { typedef uint8_t Type; };
template <> struct RingIndex<false> { typedef uint16_t Type; };

template <uint16_t SIZE> struct Ring {
  static_assert(SIZE && (SIZE & (SIZE - 1)) == 0, "a ring's size is a power of two");
  static_assert(SIZE <= 32768, "head and tail run on to twice the size and more");
  typedef typename RingIndex<(SIZE <= 128)>::Type Index;

  volatile uint8_t bytes[SIZE];
  volatile Index head, tail; /* they run on to their largest, then to 0 */

  Index held() const { return (Index)(head - tail); }
  Index room() const { return (Index)(SIZE - held()); }

  /* Put a byte behind those that wait; there must be room. */
  void put(uint8_t byte) {
    bytes[head % SIZE] = byte;
    head = (Index)(head + 1);
  }

  /* Take a byte; there must be one. */
  uint8_t take() {
    uint8_t byte = bytes[tail % SIZE];
    tail = (Index)(tail + 1);
    return byte;
  }
};
