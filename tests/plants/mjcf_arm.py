"""A crane of a slide and three joints that turn, as an MJCF file with actuators of three kinds."""

ARM = """
<mujoco model="crane">
<option gravity="0.5 0 -9.81"/>
<worldbody>
  <body name="rail" pos="0 0.2 0.3" euler="0 0 40">
    <joint name="x" type="slide" axis="1 0.2 0" range="-1 1" limited="true" damping="4"/>
    <geom type="box" size=".2 .3 .1" pos=".1 0 .05" euler="10 20 30"/>
    <body name="upper" pos="0 0 .4" quat="0.8 0.2 0.5 0.1">
      <joint name="turn" axis="0 0 1" pos=".02 0 0" armature="12" ref="20"/>
      <joint name="bend" axis="0 1 0" pos="0 .03 .01" stiffness="40000" damping="30"/>
      <geom type="capsule" size=".08" fromto="0 0 0 .1 0 .8"/>
      <body name="plate" pos="0 0 .8"><geom type="box" size=".1 .1 .02"/>
        <body name="fore"><joint name="lift" axis="0 1 0"/><geom type="ellipsoid" size=".3 .1 .05" pos=".3 0 .02"/>
          <site name="tool" pos=".6 .1 0" euler="0 90 0"/></body></body>
    </body>
  </body>
</worldbody>
<actuator>
  <motor name="a" joint="x" ctrlrange="-7 7"/>
  <general name="b" jointinparent="turn" gear="-60" gainprm="0.5" ctrlrange="-8 8" forcerange="-3 3"/>
  <position name="c" joint="lift" kp="10" ctrlrange="-1 1"/>
</actuator>
</mujoco>
"""
