"""CasADi functions as native code, with one instance of the function in each lane of the processor's vectors.

`compile_kernel(function)` translates the elementary instructions of an SX function into LLVM's language (`emit`,
`lanes`) and compiles them for this processor (`native`). It stores the result on disk (`worm3d.machine.cache`), and
returns a `Kernel`. `evaluate` calls a kernel by its address, from Python and from code that Numba compiles:

    kernel = compile_kernel(function)
    inputs, outputs = kernel.allocate(count)
    evaluate(kernel.address, inputs, outputs, count)  # also inside @worm3d.machine.compiled.njit

The compiler may fuse multiplication and addition, and may use reciprocals for several divisions (LLVM's `contract` and
`arcp`), but changes nothing else. Results therefore equal the results of CasADi's virtual machine up to rounding, and
NaN propagates in the same way. Both use C's fmin and fmax, which ignore a NaN if the other argument is a number.
"""

from worm3d.machine.codegen.call import evaluate
from worm3d.machine.codegen.emit import UnsupportedError
from worm3d.machine.codegen.kernel import Kernel, compile_kernel
from worm3d.machine.codegen.native import Host, this_host

__all__ = ["Host", "Kernel", "UnsupportedError", "compile_kernel", "evaluate", "this_host"]
