"""Logs as they come from a real robot: what is wrong is mended by a stated rule and counted, or refused.

- grid:          gaps in a column of times                 -> missing samples
- clock:         a period of a fraction of samples         -> resampled
- dropped:       samples that the logger lost or doubled   -> missing samples
- missing:       NaN                                       -> the same phase of the other periods
- spikes:        single samples far off                    -> the same phase of the other periods
- extremes:      a channel that runs into its limit        -> a word, or refused
- quantisation:  the steps of an encoder                   -> a word with their noise
- wander:        a slow movement that does not repeat      -> a word
- delay:         two logs that started at different times  -> shifted

Arrays in, arrays and findings out. Signals are (n, c), periodic after L samples, with sign -1 as x(t + L) = -x(t).
"""
