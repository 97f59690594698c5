"""What we know about a part: learning, matching, scoring and judging, without touching the world.

The way in: `models.learning.learn` makes an `models.appearance.Appearance` from golden sweeps of `models.frame.Frame`;
`models.inspection.begin`, `step` and `conclude` inspect a part against it; `models.verdict` holds what they answer.
README.md beside this file tells the way from frame to verdict, and what was decided.

Letters and words, everywhere the same:

x (p,)   prepared pixels               z (k,)   coordinates in the eigenspace
s        sweep coordinate, 0 to 1      q (m,)   task parameters
place    a reference picture of the sweep, counted from 0; `at` is a place and a fraction
pose     shift x and y in pixels, rotation in radians: where a picture lies on its reference
light    gain, offset in grey levels, shading across and down
sight    what was seen from one place, kept until the next ones agree or not
"""
