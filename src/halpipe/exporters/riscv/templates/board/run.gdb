# Load the bundle and start every hart, then read the trace after some seconds, in the folder of the bundle:
#
#     riscv64-unknown-elf-gdb -ex "target extended-remote :3333" -x board/run.gdb
#
# The server has one thread for each hart. This was run with QEMU's machine virt, and on no board.
set pagination off
set confirm off
set arch riscv:rv64
load bundle.elf
set {unsigned long} {{ memory.control | hex }} = 0
thread apply all set $pc = {{ memory.base | hex }}
python
import gdb, threading
threading.Timer(float(gdb.convenience_variable("seconds") or 5), lambda: gdb.post_event(lambda: gdb.execute("interrupt"))).start()
end
continue
dump binary memory memory.bin {{ memory.base | hex }} {{ profile.main.end | hex }}
shell halpipe deploy trace . memory.bin -o seen.csv
kill
quit
