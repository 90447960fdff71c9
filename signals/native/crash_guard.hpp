// Last words of a process that a native library ends: a message, a status, and the content of result files.
//
// Libraries crash or call exit() when memory runs out: OpenBLAS while it is loaded, MuJoCo while it compiles a map.
// Python then has no say, the status is that of a signal or 1, and a result file still says that the run goes on.
#pragma once

#include <string>

namespace hil::crash_guard {

// Texts of the two causes that the handler tells apart: whether 256 MiB could be had or not.
struct Words {
    std::string crashed, no_memory;
};

// Handle SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT and a library's exit(): write `words` to standard error and every
// file of `keep`, then end with `status`.
void arm(int status, Words words);

// Back to the system's handlers, for a child process whose parent tells how it ended.
void disarm();

// The program is over, with this status: whatever a library does at exit changes nothing.
void end(int status);

// Content for a result file if the process crashes, in place of an earlier one; empty words: none.
void keep(const std::string &path, Words words);

}  // namespace hil::crash_guard
