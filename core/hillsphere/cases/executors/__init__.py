"""Where the blocks of a campaign are computed: in this process, in others, on other machines."""
