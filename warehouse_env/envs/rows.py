"""The rows of a VecEnv, filled from a block of worlds."""

from warehouse_env.kernel import kernel


@kernel
def write_rows(reward, terminated, truncated, rewards, dones, returns):
    """Write a block's rewards [B, N] and ends [B, N], [B] into its rows, and add to their returns; is any row done?

    One kernel, because after a step of the Simulator has filled the caches each call of NumPy takes 10 us.
    """
    some_done = False
    row = 0
    for world in range(reward.shape[0]):
        for robot in range(reward.shape[1]):
            rewards[row] = reward[world, robot]
            returns[row] += reward[world, robot]
            dones[row] = terminated[world, robot] or truncated[world]
            some_done |= dones[row]
            row += 1
    return some_done
