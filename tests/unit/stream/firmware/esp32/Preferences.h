#pragma once
#include <stddef.h>
class Preferences {
public:
  Preferences();
  ~Preferences();
  bool begin(const char *name, bool readOnly = false, const char *partition_label = nullptr);
  void end();
  size_t putBytes(const char *key, const void *value, size_t len);
  size_t getBytes(const char *key, void *buf, size_t maxLen);
};
