"""CasADi functions as native code, with one instance of the function in each lane of the processor's vectors.

`compile_kernel(function)` writes the elementary instructions of an SX function in LLVM's language
(`emit`, `lanes`), compiles them for this processor (`native`), keeps the result on disk
(`worm3d.machine.cache`), and returns a `Kernel`. The kernel is called from Python, or by address from Numba's compiled
code:

    kernel = compile_kernel(function)
    inputs, outputs = kernel.allocate(count)
    kernel(inputs, outputs, count)  # Python
    evaluate(kernel.address, inputs, outputs, count)  # inside @worm3d.machine.compiled.njit

Arithmetic may fuse multiplication and addition and share reciprocals (LLVM's `contract arcp`), nothing else. Results
therefore equal CasADi's virtual machine up to rounding, and NaN propagates in the same way; note that in both C's fmin
and fmax drop a NaN beside a number.
"""

from worm3d.machine.codegen.call import evaluate
from worm3d.machine.codegen.emit import UnsupportedError
from worm3d.machine.codegen.kernel import Kernel, compile_kernel
from worm3d.machine.codegen.native import Host, this_host

__all__ = ["Host", "Kernel", "UnsupportedError", "compile_kernel", "evaluate", "this_host"]
