#pragma once
#include <stdint.h>
typedef enum { WIFI_OFF = 0, WIFI_STA = 1 } wifi_mode_t;
typedef enum { WL_IDLE_STATUS = 0, WL_CONNECTED = 3 } wl_status_t;
class IPAddress {
public:
  operator uint32_t() const;
};
class WiFiClass {
public:
  static void persistent(bool persistent);
  static bool mode(wifi_mode_t m);
  static bool setSleep(bool enabled);
  bool setAutoReconnect(bool autoReconnect);
  wl_status_t begin(const char *ssid, const char *passphrase = nullptr);
  static wl_status_t status();
  IPAddress localIP() const;
};
extern WiFiClass WiFi;
