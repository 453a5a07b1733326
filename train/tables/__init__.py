"""The tables of `warehouse tables`, from fixed seeds: the papers', all planners, policies on many floors."""
