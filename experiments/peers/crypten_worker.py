"""The works in CrypTen: one process for each party, the first party trusted to deal."""

# pyright: reportMissingImports=false
import sys
import types

from harness import job, save, timed

# CrypTen 0.4.1 imports a module that torch no longer has; it is only needed to read ONNX models.
registration = types.ModuleType("torch.onnx._internal.registration")
registration.registry = None  # pyright: ignore[reportAttributeAccessIssue]
sys.modules["torch.onnx._internal.registration"] = registration

import crypten  # noqa: E402
import torch  # noqa: E402
from crypten import mpc  # noqa: E402

JOB = job()


def forward(weights, x):
    for kernel, bias in weights[:-1]:
        x = (x.matmul(kernel) + bias).relu()
    kernel, bias = weights[-1]
    return x.matmul(kernel) + bias


def secret(array, requires_grad=False):
    return crypten.cryptensor(torch.from_numpy(array), requires_grad=requires_grad)


def train(weights, x, y):
    for array in (a for layer in weights for a in layer):
        array.grad = None
    loss = (forward(weights, x) - y).square().sum()
    loss.backward()
    updated = []
    with crypten.no_grad():
        for kernel, bias in weights:
            updated.append((kernel - kernel.grad * JOB.rate, bias - bias.grad * JOB.rate))
    return [*(a for kernel, bias in updated for a in (kernel, bias)), loss]


@mpc.run_multiprocess(world_size=JOB.parties)
def party():
    torch.set_num_threads(1)
    data = [secret(array) for array in JOB.data]
    public = JOB.work == "forward-public"
    if public:
        weights = [tuple(torch.from_numpy(a) for a in layer) for layer in JOB.weights]
    else:
        training = JOB.work == "train"
        weights = [tuple(secret(a, requires_grad=training) for a in layer) for layer in JOB.weights]
    step = {
        "product": lambda: [data[0].matmul(data[1])],
        "relu": lambda: [data[0].relu()],
        "forward": lambda: [forward(weights, data[0])],
        "forward-public": lambda: [forward(weights, data[0])],
        "train": lambda: train(weights, *data),
    }[JOB.work]
    communicator = crypten.comm.get()
    seconds, outputs = timed(step, communicator.barrier, JOB.repeats)
    # Its own decoding is off by one for some negative values; the ring elements are right.
    revealed = [(x.reveal().double() / x.encoder.scale).numpy() for x in outputs]
    if communicator.get_rank() == 0:  # here, as large results of a process would fill its launcher's queue
        save(JOB.result, seconds, revealed)


if __name__ == "__main__" and not party():
    sys.exit("a party failed")
