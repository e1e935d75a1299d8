%% The classes of a robot's events: events of one moment are handled in the order of their classes,
%% and within a class by their source robot and its count of events. Every driver keeps this order.
%% The order of booting: starl_robot_machines.

%% effects of the world on the robot, and the chassis' own steps
-define(CLASS_WORLD, 0).
%% timers, and answers of the chassis
-define(CLASS_TIMER, 1).
-define(CLASS_PACKET, 2).
