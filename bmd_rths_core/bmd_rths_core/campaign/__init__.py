"""Campaign: many ground motions, schemes and variations of one configuration, as fast as the computer can."""
