/* What the sketch takes of an Arduino core's Serial over USB. */
#pragma once
#include <stddef.h>
#include <stdint.h>
struct UsbSerial {
  void begin(unsigned long baud = 115200);
  int available();
  int read();
  int availableForWrite();
  size_t write(const uint8_t *bytes, size_t size);
};
extern UsbSerial Serial;
