"""The benchmark problem of virtual real-time hybrid simulation (Silva et al. 2020): a displacement at the interface."""
