"""The works in PriX's CrypTen mode: one process for each party, the first party trusted to deal."""

# pyright: reportMissingImports=false
import jax
import prix
from harness import by_hand, job, save, timed

JOB = job()


def forward(weights, x):
    for kernel, bias in weights[:-1]:
        x = (x @ kernel + bias).relu()
    kernel, bias = weights[-1]
    return x @ kernel + bias


def train(weights, x, y):
    updated, loss = by_hand(
        JOB,
        weights,
        x,
        y,
        transpose=lambda a: a.transpose(0, 1),
        column_sum=lambda a: a.sum(dim=0),
    )
    return [*(a for layer in updated for a in layer), loss]


def party():
    data = [prix.array(array) for array in JOB.data]
    weights = JOB.weights
    if JOB.work != "forward-public":
        weights = [tuple(prix.array(a) for a in layer) for layer in weights]
    step = {
        "product": lambda: [data[0] @ data[1]],
        "relu": lambda: [data[0].relu()],
        "forward": lambda: [forward(weights, data[0])],
        "forward-public": lambda: [forward(weights, data[0])],
        "train": lambda: train(weights, *data),
    }[JOB.work]

    def finished():
        outputs = step()
        jax.block_until_ready([x.share for x in outputs])
        return outputs

    communicator = prix.comm.get()
    seconds, outputs = timed(finished, communicator.barrier, JOB.repeats)
    revealed = [x.get_plain_text() for x in outputs]
    if communicator.get_rank() == 0:  # here, as large results of a process would fill its launcher's queue
        save(JOB.result, seconds, revealed)


if __name__ == "__main__":
    prix.run(party, world_size=JOB.parties, mode="crypten")
