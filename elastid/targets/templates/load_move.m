% The move of ${name}: timeseries of position, velocity and torque of each motor, link side, SI.
move = load(fullfile(fileparts(mfilename('fullpath')), 'move.mat'));
for part = {'position', 'velocity', 'torque'}
    if exist('timeseries') > 0
        move.(part{1}) = timeseries(move.(part{1}), move.time);
    end
end
