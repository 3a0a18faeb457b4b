#pragma once
#include <stddef.h>
#include <stdint.h>
typedef uint32_t socklen_t;
typedef uint8_t sa_family_t;
struct in_addr { uint32_t s_addr; };
struct sockaddr { uint8_t sa_len; sa_family_t sa_family; char sa_data[14]; };
struct sockaddr_in { uint8_t sin_len; sa_family_t sin_family; uint16_t sin_port; struct in_addr sin_addr; char sin_zero[8]; };
#define AF_INET 2
#define SOCK_DGRAM 2
#define MSG_DONTWAIT 0x08
static inline uint16_t htons(uint16_t x) { return (uint16_t)(x << 8 | x >> 8); }
extern "C" {
int lwip_socket(int domain, int type, int protocol);
int lwip_bind(int s, const struct sockaddr *name, socklen_t namelen);
int lwip_recvfrom(int s, void *mem, size_t len, int flags, struct sockaddr *from, socklen_t *fromlen);
int lwip_sendto(int s, const void *data, size_t size, int flags, const struct sockaddr *to, socklen_t tolen);
}
