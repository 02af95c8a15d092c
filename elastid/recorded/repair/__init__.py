"""Faults of the logs of a real robot: each is repaired by a stated rule and counted, reported, or refused.

- sample_times:  gaps in a column of times                 -> missing samples
- clock:         a period of a fraction of samples         -> resampled
- lost_samples:  samples that the logger lost or doubled   -> missing samples
- missing:       NaN                                       -> the same phase of the other periods
- spikes:        single samples far off                    -> the same phase of the other periods
- clipping:      a channel that runs into its limit        -> reported, or refused
- quantisation:  the steps of an encoder                   -> reported with their noise
- drift:         a slow movement that does not repeat      -> reported
- delay:         two logs that started at different times  -> shifted

Arrays in, arrays and findings out. Signals are (n, c), periodic after L samples, with sign -1 as x(t + L) = -x(t).
"""
