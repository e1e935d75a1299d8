%% The classes of a robot's events, in the order in which those of one moment are handled. Within a
%% class they are ordered by the robot that they come from, and by its count of events. Each driver
%% keeps to it; boot order: starl_robot_order.

%% what the world does to the robot, and its chassis by itself
-define(CLASS_WORLD, 0).
%% timers, and what the chassis says
-define(CLASS_TIMER, 1).
-define(CLASS_PACKET, 2).
