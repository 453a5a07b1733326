"""The actor and the critic that the trainers fit: two separate networks shared by all robots."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from agents.policy import draw_discrete
from agents.route_command import cruise_output
from agents.weights_folder import Activation, Network
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.observation import observation_layout

# How strongly the untrained policy prefers a command without a conflict, a fast one, and the route itself (logits).
FIRST_FREE = 18.0  # from an immediate conflict to none
FIRST_SPEED = 4.0  # from standing to the fastest level, where there is no conflict
FIRST_OFFSET = 2.0  # per metre to either side
FIRST_LEFT = 0.8  # per metre to the left, on top: pass on the right
FIRST_BRAKE = 3.0  # to brake where every command leads to an immediate conflict
PASSED = math.tanh(math.tanh(0.5))  # what two tanh layers make of 0.5
_HALF_LOG_TAU = 0.5 * math.log(2.0 * math.pi)


def _layers(sizes: Sequence[tuple[int, int]], last_gain: float) -> nn.ModuleList:
    layers = nn.ModuleList()
    for index, (inputs, outputs) in enumerate(sizes):
        layer = nn.Linear(inputs, outputs)
        nn.init.orthogonal_(layer.weight, math.sqrt(2.0) if index < len(sizes) - 1 else last_gain)
        nn.init.zeros_(layer.bias)
        layers.append(layer)
    return layers


ACTIVATIONS: dict[Activation, Callable[[Tensor], Tensor]] = {
    "tanh": torch.tanh,
    "relu": nn.functional.relu,
    "leaky_relu": nn.functional.leaky_relu,
    "elu": nn.functional.elu,
    "silu": nn.functional.silu,
    "sigmoid": torch.sigmoid,
}


def _run(layers: nn.ModuleList, x: Tensor, activation: Activation) -> Tensor:
    for layer in layers[:-1]:
        x = ACTIVATIONS[activation](layer(x))
    return cast(Tensor, layers[-1](x))


class ActorCritic(nn.Module):
    """A policy over the next action command, and the value that serves as its baseline.

    The tensors of `state_dict` are exactly those of a weights folder: actor.K.weight, actor.K.bias, critic.K.weight,
    critic.K.bias and, for real-valued actions, log_std.
    """

    log_std: Tensor

    def __init__(self, network: Network, first_output: NDArray[np.float32], log_std: float = -0.7) -> None:
        """Start near one action: `first_output` float32[A] becomes the bias of the actor's last layer.

        It holds logits of discrete actions, or the mean of real-valued ones, whose standard deviation is e^log_std.
        """
        super().__init__()
        self.network = network
        self.actor = _layers(network.sizes("actor"), last_gain=0.01)
        self.critic = _layers(network.sizes("critic"), last_gain=1.0)
        with torch.no_grad():
            self.actor[-1].get_parameter("bias").copy_(torch.as_tensor(first_output))
        if not network.discrete:
            self.log_std = nn.Parameter(torch.full((network.actions,), log_std))

    def actor_parameters(self) -> list[nn.Parameter]:
        """Return the parameters of the policy alone."""
        return [parameter for name, parameter in self.named_parameters() if not name.startswith("critic.")]

    def output(self, observation: Tensor) -> Tensor:
        """Return logits, or means of real-valued actions, float32[M, A] from float32[M, D]."""
        return _run(self.actor, observation, self.network.activation)

    def value(self, observation: Tensor) -> Tensor:
        """Return the critic's value, float32[M] from float32[M, D]."""
        return _run(self.critic, observation, self.network.activation).squeeze(-1)

    def judge(self, output: Tensor, action: Tensor) -> tuple[Tensor, Tensor]:
        """Return log pi(action) and the entropy of pi, both float32[M], from the actor's output float32[M, A].

        action: int64[M] for discrete actions, float32[M, A] for real-valued ones (as drawn, not clipped).
        """
        if self.network.discrete:
            logs = torch.log_softmax(output, dim=-1)
            return logs.gather(-1, action.unsqueeze(-1)).squeeze(-1), -(logs.exp() * logs).sum(-1)
        standard = (action - output) * torch.exp(-self.log_std)
        log_probability = (-0.5 * standard**2 - self.log_std - _HALF_LOG_TAU).sum(-1)
        return log_probability, (self.log_std + 0.5 + _HALF_LOG_TAU).sum().expand(len(action))

    @torch.no_grad()
    def draw(self, output: Tensor, rng: np.random.Generator | torch.Generator) -> tuple[Tensor, Tensor]:
        """Draw one action a row: int64[M], or float32[M, A] for real-valued ones, and log pi of it, float32[M].

        output: the actor's, float32[M, A]; rng: NumPy's, which is faster on the CPU, or torch's of the output's device.
        """
        if isinstance(rng, torch.Generator):
            action = self._drawn(output, rng)
            return action, self.judge(output, action)[0]
        here = output.numpy()
        if self.network.discrete:
            drawn = draw_discrete(here, rng)
            here = here - here.max(axis=-1, keepdims=True)
            chosen = here[np.arange(len(drawn)), drawn]
            return torch.from_numpy(drawn), torch.from_numpy(chosen - np.log(np.exp(here).sum(axis=-1)))
        noise = rng.standard_normal(here.shape, dtype=np.float32)
        log_std = self.log_std.numpy()
        log_probability = (np.float32(-0.5) * noise**2 - log_std - np.float32(_HALF_LOG_TAU)).sum(axis=-1)
        return torch.from_numpy(here + noise * np.exp(log_std)), torch.from_numpy(log_probability)

    def _drawn(self, output: Tensor, rng: torch.Generator) -> Tensor:
        if self.network.discrete:  # by the Gumbel trick, as in draw_discrete
            uniform = torch.rand(output.shape, generator=rng, device=output.device)
            return (output - (-uniform.log()).log()).argmax(-1)
        return output + torch.randn(output.shape, generator=rng, device=output.device) * self.log_std.exp()


def first_actor_critic(network: Network, env: EnvConfig, cruise_bias: float) -> ActorCritic:
    """Return the networks that a training begins with.

    With predictions in the observation and discrete actions, the actor's first units carry them through to the
    logits, so that it prefers the fastest command without a conflict; else it prefers to cruise.
    """
    if not (network.discrete and env.sensor.predictions):
        return ActorCritic(network, cruise_output(env, cruise_bias))
    table = np.array([(v, o) for v in env.speed_levels for o in env.lateral_offsets], np.float32)
    aside = FIRST_OFFSET * np.abs(table[:, 1]) + FIRST_LEFT * np.maximum(table[:, 1], 0.0)
    free = FIRST_FREE + FIRST_SPEED * table[:, 0] / table[:, 0].max() - aside  # the logit without a conflict
    hit = np.where(table[:, 0] == 0.0, FIRST_BRAKE, 0.0)  # and with an immediate one
    net = ActorCritic(network, (0.5 * (free + hit)).astype(np.float32))
    start = observation_layout(env).slices["predictions"].start
    if min(network.hidden) < network.actions:
        raise ConfigError(f"hidden={network.hidden} must hold at least {network.actions} units, one for each action")
    units = torch.arange(network.actions)
    with torch.no_grad():
        for number, layer in enumerate(net.actor):
            weight = layer.get_parameter("weight")
            inputs = units + start if number == 0 else units
            if number < len(net.actor) - 1:
                weight[units] = 0.0
                weight[units, inputs] = 1.0
                layer.get_parameter("bias")[units] = -0.5 if number == 0 else 0.0
            else:
                weight[units, inputs] = torch.from_numpy(free - hit).float() / (2.0 * PASSED)
    return net


def begin_with(net: ActorCritic, tensors: Mapping[str, NDArray[np.float32]]) -> None:
    """Copy a policy's tensors into a network; where they lack the critic, it stays untrained.

    The last slices of an observation may be missing in the policy's: it begins by ignoring them. Raises ConfigError
    where anything else differs.
    """
    for name, own in net.state_dict().items():
        if name not in tensors and name.startswith("critic."):
            continue
        if name not in tensors:
            raise ConfigError(f"--start: the policy has no {name}")
        given = torch.from_numpy(tensors[name])
        if name.endswith(".0.weight") and given.shape[1] < own.shape[1]:
            given = nn.functional.pad(given, (0, own.shape[1] - given.shape[1]))
        if given.shape != own.shape:
            shapes, remedy = f"{list(given.shape)}, not {list(own.shape)}", "give its --hidden and --traffic"
            raise ConfigError(f"--start: {name} of the policy is {shapes}; {remedy}, or --start None")
        own.copy_(given)


def tensors_of(module: nn.Module) -> dict[str, NDArray[np.float32]]:
    """Return the module's tensors as arrays, copied: what `save_policy` takes."""
    return {name: tensor.detach().cpu().numpy().copy() for name, tensor in module.state_dict().items()}
