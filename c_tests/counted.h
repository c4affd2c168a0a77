/*
 * A real number that counts what is done with it: in place of float or double in a generated observer, compiled as C++.
 *
 * Negation is not counted: it changes a bit. A comparison of the selection is one of "key[k] > key[best]", an exchange
 * a column that is not the largest where it stands.
 */
#ifndef COUNTED_H
#define COUNTED_H

#include <stdint.h>

struct work {
    uint32_t multiply, divide, add, compare, selections, exchanges;
};

static work done;

template <typename number> struct counted {
    number value;

    counted() = default;
    constexpr counted(number x) : value(x) {}
    friend counted operator-(counted a) { return counted(-a.value); }
    friend counted operator*(counted a, counted b) { done.multiply++; return counted(a.value * b.value); }
    friend counted operator/(counted a, counted b) { done.divide++; return counted(a.value / b.value); }
    friend counted operator+(counted a, counted b) { done.add++; return counted(a.value + b.value); }
    friend counted operator-(counted a, counted b) { done.add++; return counted(a.value - b.value); }
    counted &operator+=(counted b) { return *this = *this + b; }
    counted &operator-=(counted b) { return *this = *this - b; }
    counted &operator*=(counted b) { return *this = *this * b; }
    friend bool operator<(counted a, counted b) { done.compare++; return a.value < b.value; }
    friend bool operator>(counted a, counted b) { done.compare++; return a.value > b.value; }
    friend bool operator<=(counted a, counted b) { done.compare++; return a.value <= b.value; }
    friend bool operator>=(counted a, counted b) { done.compare++; return a.value >= b.value; }
};

#endif
